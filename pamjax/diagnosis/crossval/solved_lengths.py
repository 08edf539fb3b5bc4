"""Predicted lengths of an isotonic test that solve the balance of force.

A fit predicts a length by one step of Newton's method from the measured length (`model/isotonic.py`). Far
from the measured length, as on a held-out block, this step is inaccurate. It is therefore repeated from its
own result. The memories then follow the predicted motion instead of the measured one.

A row keeps its single step if the repetition does not converge there, as in friction before it slides.
"""

from __future__ import annotations

import dataclasses

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.model.isotonic import repeat_steps

#: A length is solved if its step is below this share of it; largest number of steps.
_TOLERANCE, _MAX_STEPS = 1e-5, 40


def predict_solved(problem: LibraryProblem, values: np.ndarray) -> np.ndarray:
    """Return the predicted channels, (2, n), at parameter values (p,), SI, with solved lengths."""
    single_step = problem.predict(values)
    if not problem.case.recording.measures_length:
        return single_step

    def take_step(length: Array) -> tuple[Array, np.ndarray]:
        prediction = _replace_lengths(problem, length).predict(values)
        return jnp.asarray(prediction[0]), prediction

    prediction, is_solved = repeat_steps(take_step, jnp.asarray(single_step[0]), _TOLERANCE, _MAX_STEPS)
    return np.where(np.asarray(is_solved), prediction, single_step)


def _replace_lengths(problem: LibraryProblem, length: Array) -> LibraryProblem:
    """Return the problem with other lengths, (n,) m, from which the step starts."""
    lengths = problem.dataset.rows.length.at[: problem.n].set(length)
    dataset = eqx.tree_at(lambda d: d.rows.length, problem.dataset, lengths)
    return dataclasses.replace(problem, dataset=dataset)
