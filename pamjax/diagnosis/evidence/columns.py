"""Columns of the linear model: form errors of mechanisms, and physics that no mechanism describes."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from pamjax.diagnosis.evidence.coordinates import Coordinates
from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.candidate_fit import switch_off_candidate
from pamjax.infer.noise.noise_model import NoiseModel
from pamjax.infer.problem.dataset import CHANNELS
from pamjax.model.form_error import FormError
from pamjax.model.registry import list_mechanisms

#: Highest degrees of unknown smooth physics in pressure and length, and their sum.
MAX_DEGREE, MAX_TOTAL_DEGREE = 4, 6
#: Local bumps over the stroke, and their width as a share of it.
BUMP_COUNT, BUMP_WIDTH = 16, 0.04
#: Periods over the stroke, and over the recording.
STROKE_HARMONICS, TIME_HARMONICS = range(3, 9), range(1, 17)


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
    return _equalise(np.stack(columns), effect) / np.sqrt(len(columns))


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


def build_generic_families(problem: LibraryProblem, coordinates: Coordinates) -> list[np.ndarray]:
    """Return families of generic physics, (g, 2, n) each, dimensionless.

    In force: smooth in pressure and length, dependent on direction, local or periodic in length, and slow in
    time. In diameter: smooth or slow.
    """
    c = coordinates
    smooth = [
        c.evaluate_power("pressure", i) * c.evaluate_power("length", k)
        for i in range(MAX_DEGREE + 1)
        for k in range(MAX_DEGREE + 1)
        if i + k <= MAX_TOTAL_DEGREE
    ]
    hysteretic = [
        c.direction * c.evaluate_power("pressure", i) * c.evaluate_power("length", k)
        for i in range(3)
        for k in range(3)
    ]
    stroke = (c.length + 1) / 2
    bumps = [np.exp(-0.5 * ((stroke - centre) / BUMP_WIDTH) ** 2) for centre in np.linspace(0, 1, BUMP_COUNT)]
    periodic = [f(2 * np.pi * k * stroke) for k in STROKE_HARMONICS for f in (np.cos, np.sin)]
    slow = [] if c.time is None else [c.evaluate_power("time", k) for k in TIME_HARMONICS]
    slow_pressure = [course * c.pressure for course in slow[:4]]
    zero = np.zeros(problem.n)
    in_force = [smooth, hysteretic, bumps + periodic, slow + slow_pressure]
    in_diameter = [smooth + slow[:4]]
    families = [[np.stack([f, zero]) for f in family] for family in in_force]
    families += [[np.stack([zero, f]) for f in family] for family in in_diameter]
    return [np.stack(family) for family in families if family]


def whiten_generic_families(
    noise: NoiseModel, families: Sequence[np.ndarray]
) -> tuple[np.ndarray, list[slice]]:
    """Return whitened generic columns, (g, size), and the rows of each family.

    The columns of a family together have unit variance per sample.
    """
    sd = np.ones((len(CHANNELS), 1))
    for c, channel in enumerate(noise.channels):
        if channel is not None and noise.rows[c].size:
            sd[c] = float(np.mean(channel.sd[noise.rows[c]]))
    whitened = []
    for columns in families:
        white = np.nan_to_num(noise.whiten(columns * sd))
        rms = np.sqrt(np.mean(white**2, axis=1))
        has_effect = rms > 1e-9
        if has_effect.any():
            whitened.append(white[has_effect] / rms[has_effect][:, None] / np.sqrt(has_effect.sum()))
    bounds = np.cumsum([0, *(len(white) for white in whitened)])
    return np.concatenate(whitened), [slice(a, b) for a, b in pairwise(bounds.tolist())]


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
    """Return columns scaled to the rms of the effect."""
    scale = np.where(np.mean(effect**2, axis=1) > 0, np.mean(effect**2, axis=1), np.inf)
    size = np.sqrt(np.mean(columns**2 / scale[:, None], axis=(1, 2)) * 2 / np.isfinite(scale).sum().clip(1))
    return columns / np.where(size > 1e-9, size, np.inf)[:, None, None]


def stack_whitened(noise: NoiseModel, blocks: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return blocks of columns, (r, 2, n) each, whitened, (r, size) each."""
    return [np.nan_to_num(noise.whiten(block)) if len(block) else block[:, 0, :0] for block in blocks]
