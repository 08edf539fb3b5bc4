"""Columns of the form error of a candidate."""

from __future__ import annotations

import numpy as np

from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.model_fit import switch_off_candidate
from pamjax.infer.form_errors.columns import build_columns_of_effect
from pamjax.infer.form_errors.coordinates import Coordinates
from pamjax.infer.problem.dataset import CHANNELS
from pamjax.model.registry import find_mechanism


def build_coordinates(problem: LibraryProblem) -> Coordinates:
    """Return the variables of the form errors at each row of the recording."""
    rate = np.asarray(problem.dataset.history.rate(problem.dataset.rows.length))[: problem.n]
    is_compared = np.asarray(np.isfinite(problem.measured).any(axis=0))
    return Coordinates.from_recording(problem.case.recording, is_compared, rate)


def compute_effect(problem: LibraryProblem, values: np.ndarray, candidate: Candidate) -> np.ndarray:
    """Return what a candidate changes in the prediction, SI, (2, n); zero where a state has no answer."""
    return np.nan_to_num(
        problem.predict(values) - problem.predict(switch_off_candidate(problem, values, candidate))
    )


def build_form_columns(
    problem: LibraryProblem, coordinates: Coordinates, values: np.ndarray, candidate: Candidate
) -> np.ndarray:
    """Return the columns of a candidate's form error, SI, (r, 2, n), each of the rms of the effect / √r."""
    form_error = find_mechanism(candidate.id).form_error
    if not (form_error.terms or form_error.shape_factors):
        return np.zeros((0, len(CHANNELS), problem.n))
    effect = compute_effect(problem, values, candidate)
    reshaped_effects = [
        _compute_reshaped_effect(problem, values, candidate, factors) for factors in form_error.shape_factors
    ]
    return build_columns_of_effect(form_error, coordinates, effect, reshaped_effects)


def _compute_reshaped_effect(
    problem: LibraryProblem, values: np.ndarray, candidate: Candidate, factors: dict[str, float]
) -> np.ndarray:
    """Return the effect of a candidate with factors on its shape parameters, SI, (2, n)."""
    factor_by_name = {f"{candidate.id}.{name}": factor for name, factor in factors.items()}
    shape = {name: values[problem.index(name)] * factor for name, factor in factor_by_name.items()}
    return compute_effect(problem, problem.set_shape(values, shape), candidate)
