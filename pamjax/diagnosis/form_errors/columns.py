"""Columns of the form error of a candidate."""

from __future__ import annotations

import numpy as np

from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.model_fit import switch_off_candidate
from pamjax.infer.form_errors.columns import build_columns_of_effect
from pamjax.infer.form_errors.coordinates import Coordinates, CoordinateScales
from pamjax.infer.form_errors.form_source import FormSource, build_form_source
from pamjax.infer.problem.dataset import CHANNELS
from pamjax.model.registry import find_mechanism


def build_coordinates(problem: LibraryProblem) -> Coordinates:
    """Return the variables of the form errors at each row of the recording."""
    return Coordinates.from_recording(problem.case.recording, *_find_compared_rows(problem))


def _find_compared_rows(problem: LibraryProblem) -> tuple[np.ndarray, np.ndarray]:
    """Return whether a row has a compared sample, and its rate of change of the length (m/s), (n,) each."""
    rate = np.asarray(problem.dataset.history.rate(problem.dataset.rows.length))[: problem.n]
    return np.asarray(np.isfinite(problem.measured).any(axis=0)), rate


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
    effect, reshaped_effects, _ = _compute_effects(problem, values, candidate)
    return build_columns_of_effect(form_error, coordinates, effect, reshaped_effects)


def build_problem_form_source(
    problem: LibraryProblem, values: np.ndarray, candidate: Candidate, share: float
) -> FormSource:
    """Return the constants of the columns of a candidate's form error, of a size as a share of the effect."""
    effect, reshaped_effects, reshaped_values = _compute_effects(problem, values, candidate)
    recording = problem.case.recording
    return build_form_source(
        find_mechanism(candidate.id).form_error,
        recording,
        CoordinateScales.from_recording(recording, *_find_compared_rows(problem)),
        build_coordinates(problem),
        effect,
        reshaped_effects,
        reshaped_values,
        share,
    )


def _compute_effects(
    problem: LibraryProblem, values: np.ndarray, candidate: Candidate
) -> tuple[np.ndarray, list[np.ndarray], list[dict[str, float]]]:
    """Return the effect of a candidate, (2, n), those with other shapes, and their shape parameters, SI."""
    reshaped_effects, reshaped_values = [], []
    for factors in find_mechanism(candidate.id).form_error.shape_factors:
        names = {field: f"{candidate.id}.{field}" for field in factors}
        reshaped = problem.set_shape(
            values, {name: values[problem.index(name)] * factors[field] for field, name in names.items()}
        )
        reshaped_effects.append(compute_effect(problem, reshaped, candidate))
        reshaped_values.append({field: float(reshaped[problem.index(name)]) for field, name in names.items()})
    return compute_effect(problem, values, candidate), reshaped_effects, reshaped_values
