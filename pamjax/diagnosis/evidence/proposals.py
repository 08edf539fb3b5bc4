"""Proposals: which mechanisms to add to a model, by linear algebra at its estimate.

At the estimate of a model, the effect of a further mechanism is nearly proportional to its amplitudes. Its
whitened derivatives T, and the columns Φ of its form error, are projected on what the free parameters of the
model do not absorb. The gain of ln Z by a set of additions then needs only the products of their columns:

    gain = ½ bᵀ (D⁻¹ + XᵀX)⁻¹ b − ½ ln det(I + D^½ XᵀX D^½) + ln P(mechanisms),     X = (T, Φ), b = Xᵀ r.

The size of a form error follows the amplitude, so both are computed in turn. Singles and pairs are proposed;
the search refits the best of them, because amplitudes are not exactly linear.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np

from pamjax.diagnosis.detect.score_test import (
    NuisanceProjection,
    ScoreDirection,
    compute_candidate_jacobians,
    compute_score_directions,
    stack_residual,
)
from pamjax.diagnosis.evidence.columns import build_columns_of_effect, get_form_error
from pamjax.diagnosis.evidence.coordinates import Coordinates
from pamjax.diagnosis.evidence.settings import EvidenceSettings
from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.least_squares import MapEstimate
from pamjax.infer.noise.noise_model import NoiseModel
from pamjax.model.registry import EXCLUSIVE_PAIRS

#: Reduction of χ² below which a mechanism is not proposed.
MIN_SCORE = 6.0
#: Candidates with different shapes for each mechanism, and mechanisms that are combined to pairs.
SHAPES_PER_MECHANISM, PAIRED_MECHANISMS = 2, 12
#: Loss of ln Z that a fitted shape parameter costs.
SHAPE_COST = 1.5
#: Rounds in which amplitudes and sizes of form errors are computed in turn.
FORM_ROUNDS = 2


@dataclass(frozen=True, eq=False)
class Proposal:
    """Mechanisms to add, with their linearised amplitudes and gain of ln Z."""

    additions: tuple[tuple[Candidate, np.ndarray], ...]
    gain: float

    @property
    def ids(self) -> frozenset[str]:
        """Ids of the added mechanisms."""
        return frozenset(candidate.id for candidate, _ in self.additions)

    @property
    def free_parameters(self) -> tuple[str, ...]:
        """Names of the parameters of the added mechanisms."""
        return tuple(sorted(name for candidate, _ in self.additions for name in candidate.free_parameters))


@dataclass(frozen=True, eq=False)
class _Addition:
    """A candidate in the linear model; all columns whitened and projected.

    Attributes:
        candidate: the candidate.
        textbook: (k, size) derivatives by its amplitudes.
        limits: (2, k) lowest and highest change of each amplitude.
        forms: (r, size) form error at a share of one and at the amplitudes of `scale`.
        scale: rms of the textbook effect for which the forms were computed.
    """

    candidate: Candidate
    textbook: np.ndarray
    limits: np.ndarray
    forms: np.ndarray
    scale: float


def propose_additions(
    problem: LibraryProblem,
    noise: NoiseModel,
    estimate: MapEstimate,
    ids: frozenset[str],
    candidates: Sequence[Candidate],
    coordinates: Coordinates,
    settings: EvidenceSettings,
) -> list[Proposal]:
    """Return singles and pairs that can be added to a model, largest gain first.

    Args:
        problem: the recording and the library.
        noise: noise with the form errors of the model's own mechanisms.
        estimate: estimate of the model.
        ids: mechanisms of the model.
        candidates: all candidates.
        coordinates: variables of form errors.
        settings: prior probabilities.
    """
    excluded_ids = {*ids, *(id for pair in EXCLUSIVE_PAIRS if pair & ids for id in pair)}
    free = [candidate for candidate in candidates if candidate.id not in excluded_ids]
    jacobians = compute_candidate_jacobians(problem, estimate, free)
    directions = compute_score_directions(problem, noise, estimate, free, jacobians)
    best_directions = _list_best_shapes(directions)
    projection = NuisanceProjection(estimate)
    residual = stack_residual(problem, estimate)
    position = {id(candidate): k for k, candidate in enumerate(free)}
    additions = [
        _build_addition(
            problem, noise, estimate, projection, coordinates, d, jacobians[position[id(d.candidate)]]
        )
        for d in best_directions
    ]
    room = settings.max_mechanisms - len(ids)
    singles = [(addition,) for addition in additions] if room >= 1 else []
    pairs = _combine(_keep_leading(additions, residual, settings)) if room >= 2 else []
    proposals = [_evaluate(group, residual, settings) for group in [*singles, *pairs]]
    return sorted((p for p in proposals if p is not None), key=lambda p: -p.gain)


def _list_best_shapes(directions: Sequence[ScoreDirection]) -> list[ScoreDirection]:
    """Return the best few shapes of each mechanism that explains anything, by its free parameters."""
    shapes: dict[tuple[str, ...], list[ScoreDirection]] = {}
    for direction in sorted(directions, key=lambda d: -d.chi2_reduction):
        group = shapes.setdefault(direction.candidate.free_parameters, [])
        if direction.chi2_reduction > MIN_SCORE and len(group) < SHAPES_PER_MECHANISM:
            group.append(direction)
    return [direction for group in shapes.values() for direction in group]


def _build_addition(
    problem: LibraryProblem,
    noise: NoiseModel,
    estimate: MapEstimate,
    projection: NuisanceProjection,
    coordinates: Coordinates,
    direction: ScoreDirection,
    jacobian: np.ndarray,
) -> _Addition:
    candidate = direction.candidate
    effect = np.nan_to_num(np.einsum("k,kcn->cn", direction.amplitudes, jacobian))
    forms = build_columns_of_effect(get_form_error(candidate), coordinates, effect)
    textbook = direction.unit_vectors * direction.norm[:, None]
    white = np.nan_to_num(noise.whiten(forms)) if len(forms) else np.zeros((0, estimate.residual.size))
    indices = [problem.index(name) for name in candidate.amplitudes]
    now = estimate.values[indices]
    return _Addition(
        candidate,
        textbook,
        np.stack([problem.low[indices] - now, problem.high[indices] - now]),
        projection.remove_from(white),
        float(np.sqrt(np.mean((direction.amplitudes @ textbook) ** 2))),
    )


def _keep_leading(
    additions: Sequence[_Addition], residual: np.ndarray, settings: EvidenceSettings
) -> list[_Addition]:
    """Return the best shape of the mechanisms with the largest gains."""
    best: dict[str, tuple[float, _Addition]] = {}
    for addition in additions:
        proposal = _evaluate((addition,), residual, settings)
        gain = -np.inf if proposal is None else proposal.gain
        id = addition.candidate.id
        if id not in best or gain > best[id][0]:
            best[id] = (gain, addition)
    ranking = sorted(best.values(), key=lambda pair: -pair[0])
    return [addition for _, addition in ranking[:PAIRED_MECHANISMS]]


def _combine(additions: Sequence[_Addition]) -> list[tuple[_Addition, ...]]:
    """Return all pairs of different mechanisms that may stand in one model."""
    return [
        pair
        for pair in combinations(additions, 2)
        if frozenset(a.candidate.id for a in pair) not in EXCLUSIVE_PAIRS
    ]


def _evaluate(
    group: tuple[_Addition, ...], residual: np.ndarray, settings: EvidenceSettings
) -> Proposal | None:
    """Return a set of additions with its gain; None if an amplitude is outside its limits."""
    columns = np.concatenate([*(a.textbook for a in group), *(a.forms for a in group)])
    gram, b = columns @ columns.T, columns @ residual
    amplitude_counts = [len(a.textbook) for a in group]
    k, bounds = sum(amplitude_counts), np.cumsum([0, *amplitude_counts])
    scales = np.ones(len(group))
    best_gain, amplitudes = -np.inf, np.zeros(k)
    for _ in range(FORM_ROUNDS):
        best_gain, solution = _choose_shares(
            gram, b, k, [len(a.forms) for a in group], scales, residual.size, settings
        )
        amplitudes = solution[:k]
        parts = [amplitudes[i:j] for i, j in pairwise(bounds)]
        scales = np.array(
            [
                float(np.sqrt(np.mean((part @ a.textbook) ** 2))) / a.scale if a.scale > 0 else 0.0
                for part, a in zip(parts, group, strict=True)
            ]
        )
    limits = np.concatenate([a.limits for a in group], axis=1)
    slack = 1e-9 + 0.02 * np.abs(amplitudes)
    if (amplitudes < limits[0] - slack).any():
        return None
    shapes = sum(len(a.candidate.shape) for a in group)
    gain = best_gain - SHAPE_COST * shapes + len(group) * np.log(settings.mechanism_probability)
    stated_cost = sum(a.candidate.stated_chi2 for a in group) / 2
    amplitudes = np.clip(amplitudes, *limits)
    parts = [amplitudes[i:j] for i, j in pairwise(bounds)]
    return Proposal(
        tuple((a.candidate, part) for a, part in zip(group, parts, strict=True)), float(gain + stated_cost)
    )


def _choose_shares(
    gram: np.ndarray,
    b: np.ndarray,
    k: int,
    form_sizes: Sequence[int],
    scales: np.ndarray,
    size: int,
    settings: EvidenceSettings,
) -> tuple[float, np.ndarray]:
    """Return the largest ln Z over the shares of the form errors, one after the other, and the solution."""
    unit = size / np.maximum(np.diag(gram)[:k], 1e-300)
    log_weight = dict(zip(settings.form_shares, np.log(settings.form_share_probabilities), strict=True))
    shares = [0.0] * len(form_sizes)

    def evaluate(trial: Sequence[float]) -> tuple[float, np.ndarray]:
        variance = np.concatenate(
            [
                unit,
                *(
                    np.full(r, (share * s) ** 2)
                    for r, share, s in zip(form_sizes, trial, scales, strict=True)
                ),
            ]
        )
        gain, solution = _compute_gain(gram, b, variance, k)
        weight = sum(log_weight[share] for share, r in zip(trial, form_sizes, strict=True) if r)
        return gain + weight, solution

    best = evaluate(shares)
    for m, r in enumerate(form_sizes):
        for share in settings.form_shares if r else ():
            trial = [*shares[:m], share, *shares[m + 1 :]]
            gain, solution = evaluate(trial)
            if gain > best[0]:
                best, shares = (gain, solution), trial
    return best


def _compute_gain(gram: np.ndarray, b: np.ndarray, variance: np.ndarray, k: int) -> tuple[float, np.ndarray]:
    """Return the gain of ln Z by columns with prior variances, and their coefficients.

    The first k columns are free.
    """
    indices = np.flatnonzero(variance > 0)
    root = np.sqrt(variance[indices])
    products = gram[np.ix_(indices, indices)] * np.outer(root, root)
    precision = np.where(indices < k, 1e-9, 1.0)
    b_scaled = b[indices] * root
    solution = np.linalg.solve(products + np.diag(precision), b_scaled)
    log_determinant = float(np.linalg.slogdet(products + np.eye(indices.size))[1])
    out = np.zeros(variance.size)
    out[indices] = solution * root
    return 0.5 * float(b_scaled @ solution) - 0.5 * log_determinant, out
