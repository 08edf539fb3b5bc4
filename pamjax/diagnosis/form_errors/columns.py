"""Columns of the linear model for the form error of a mechanism."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pamjax.diagnosis.form_errors.coordinates import Coordinates
from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.candidate_fit import switch_off_candidate
from pamjax.infer.problem.dataset import CHANNELS
from pamjax.model.form_error import FormError
from pamjax.model.registry import list_mechanisms

#: Largest factor on a column: a Legendre polynomial of degree four has a third of the rms of its limits.
MAX_GROWTH = 3.0
#: Share of the rms of the effect below which a column counts as zero.
MIN_COLUMN_RMS = 1e-9


def get_form_error(candidate: Candidate) -> FormError:
    """Return where the equation of a candidate may be inexact."""
    return list_mechanisms()[candidate.id].form_error


def compute_effect_of(problem: LibraryProblem, values: np.ndarray, candidate: Candidate) -> np.ndarray:
    """Return what a candidate changes in the prediction, SI, (2, n); zero where a state has no answer."""
    return np.nan_to_num(
        problem.predict(values) - problem.predict(switch_off_candidate(problem, values, candidate))
    )


def build_form_columns(
    problem: LibraryProblem, coordinates: Coordinates, values: np.ndarray, candidate: Candidate
) -> np.ndarray:
    """Return the columns of a candidate's form error, SI, (r, 2, n), each of the rms of the effect / √r."""
    form_error = get_form_error(candidate)
    if not (form_error.terms or form_error.alternatives):
        return np.zeros((0, len(CHANNELS), problem.n))
    effect = compute_effect_of(problem, values, candidate)
    alternatives = [
        _remove_parallel(_compute_alternative(problem, values, candidate, alternative), effect)
        for alternative in form_error.alternatives
    ]
    return build_columns_of_effect(form_error, coordinates, effect, alternatives)


def build_columns_of_effect(
    form_error: FormError,
    coordinates: Coordinates,
    effect: np.ndarray,
    alternatives: Sequence[np.ndarray] = (),
) -> np.ndarray:
    """Return the columns of the form error of an effect, (2, n), SI; (r, 2, n), each of its rms / √r.

    Args:
        form_error: the terms.
        coordinates: their variables.
        effect: change of the prediction by the mechanism.
        alternatives: changes of the effect by other shapes, (2, n) each.
    """
    # Most mechanisms act on force; diameter decides only if the force does not change.
    local = coordinates.rescale(effect[0] if effect[0].any() else effect[1])
    factors = [local.evaluate_term(term) for term in form_error.parse()]
    factors = [factor for factor in factors if factor.any()]
    if form_error.is_additive:
        return _build_course(effect, factors)
    # The amplitude of the mechanism has what is proportional to the effect.
    columns = [_remove_parallel(effect * factor, effect) for factor in factors] + list(alternatives)
    if not columns:
        return np.zeros((0, *effect.shape))
    return _equalise(np.stack(columns), effect)


def _build_course(effect: np.ndarray, factors: Sequence[np.ndarray]) -> np.ndarray:
    """Return the columns of an added course, (r, 2, n), together of the rms of the effect.

    As in a random walk, the k-th harmonic is k times smaller than the first.
    """
    if not factors:
        return np.zeros((0, *effect.shape))
    weights = 1 / np.arange(1, len(factors) + 1)
    weights *= np.sqrt(2 / np.sum(weights**2))
    size = np.sqrt(np.mean(effect**2, axis=1))[:, None]
    return np.stack([size * weight * factor for weight, factor in zip(weights, factors, strict=True)])


def _compute_alternative(
    problem: LibraryProblem, values: np.ndarray, candidate: Candidate, factors: dict[str, float]
) -> np.ndarray:
    new_values = values.copy()
    for name, factor in factors.items():
        k = problem.index(f"{candidate.id}.{name}")
        new_values[k] = np.clip(new_values[k] * factor, problem.low[k], problem.high[k])
    return compute_effect_of(problem, new_values, candidate)


def _remove_parallel(column: np.ndarray, effect: np.ndarray) -> np.ndarray:
    """Return a column without its part that is proportional to the effect, channel by channel."""
    square = np.sum(effect**2, axis=1, keepdims=True)
    share = np.sum(column * effect, axis=1, keepdims=True) / np.where(square > 0, square, 1.0)
    return column - share * effect


def _equalise(columns: np.ndarray, effect: np.ndarray) -> np.ndarray:
    """Return columns that together have the rms of the effect; a small column grows by `MAX_GROWTH`."""
    scale = np.where(np.mean(effect**2, axis=1) > 0, np.mean(effect**2, axis=1), np.inf)
    size = np.sqrt(np.mean(columns**2 / scale[:, None], axis=(1, 2)) * 2 / np.isfinite(scale).sum().clip(1))
    count = max(int(np.count_nonzero(size > MIN_COLUMN_RMS)), 1)
    growth = np.where(size > MIN_COLUMN_RMS, 1 / np.maximum(size, 1 / MAX_GROWTH), 0.0)
    return columns * (growth / np.sqrt(count))[:, None, None]
