"""Predicted lengths of an isotonic test that solve the balance of force.

A fit predicts a length by one step of Newton's method from the measured length (`model/isotonic.py`). Far
from the measured length, as on a held-out block, this step is inaccurate. It is therefore repeated from its
own result. The memories then follow the predicted motion instead of the measured one.

A row keeps its single step if the repetition does not converge there, as in friction before it slides.
"""

from __future__ import annotations

import dataclasses

import equinox as eqx
import numpy as np

from pamjax.diagnosis.library.library_problem import LibraryProblem

#: A length is solved if the next step is below this share of it; largest number of steps.
_TOLERANCE, _MAX_STEPS = 1e-5, 40
#: Largest step of the length, relative to the length, and growth of the damping if the steps do not decrease.
_MAX_STEP_SHARE, _DAMPING_GROWTH = 0.1, 1.5


def predict_solved(problem: LibraryProblem, values: np.ndarray) -> np.ndarray:
    """Return the predicted channels, (2, n), at parameter values (p,), SI, with solved lengths."""
    single_step = problem.predict(values)
    if not problem.case.recording.measures_length:
        return single_step
    length, damping = single_step[0], np.ones(problem.n)
    prediction, size = single_step, np.full(problem.n, np.inf)
    for _ in range(_MAX_STEPS):
        prediction = _replace_lengths(problem, length).predict(values)
        limit = _MAX_STEP_SHARE * length
        step = np.clip(np.nan_to_num(prediction[0] - length), -limit, limit)
        previous_size, size = size, np.abs(step / length)
        if size.max() < _TOLERANCE:
            break
        damping = np.where(size > previous_size, damping * _DAMPING_GROWTH, damping)
        length = length + step / damping
    return np.where(size < _TOLERANCE, prediction, single_step)


def _replace_lengths(problem: LibraryProblem, length: np.ndarray) -> LibraryProblem:
    """Return the problem with other lengths, (n,) m, from which the step starts."""
    datasets = [
        eqx.tree_at(lambda d: d.rows.length, dataset, dataset.rows.length.at[: problem.n].set(length))
        for dataset in (problem.dataset, problem.reduced_dataset)
    ]
    return dataclasses.replace(problem, dataset=datasets[0], reduced_dataset=datasets[1])
