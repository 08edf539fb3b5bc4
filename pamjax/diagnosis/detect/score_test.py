"""Score directions: the whitened effect of each candidate on a recording, and the misfit that it explains.

The effect is linear in the candidate's amplitudes. The part that free parameters can absorb under their
priors is removed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from pamjax.compile.parallel import parallel_map
from pamjax.diagnosis.library.candidates import TIME_COURSES, Candidate
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.least_squares import (
    MapEstimate,
    compute_limit_distances,
    compute_priors,
    find_parameters_at_limit,
    transform_to_coordinates,
)
from pamjax.infer.noise.noise_model import NoiseModel


@dataclass(frozen=True, eq=False)
class ScoreDirection:
    """Score direction of a candidate at a refit.

    Attributes:
        candidate: the candidate.
        chi2_reduction: reduction of χ² by its best amplitudes within their limits, linearised.
        amplitudes: these amplitudes, SI.
        unit_vectors: (k, size + priors) whitened unit vectors without the part that free parameters absorb.
        is_two_sided: (k,) whether an amplitude may be negative; a friction coefficient may not.
        norm: (k,) norm of the whitened direction by its amplitude, SI; 1 if the parameters absorb all of it.
    """

    candidate: Candidate
    chi2_reduction: float
    amplitudes: np.ndarray
    unit_vectors: np.ndarray
    is_two_sided: np.ndarray
    norm: np.ndarray


class NuisanceProjection:
    """Projection that removes the part of a direction that free parameters absorb under their priors.

    The priors are additional rows of the least-squares problem.

    Args:
        estimate: the refit.
        excluded_positions: positions of free parameters that absorb nothing.
    """

    def __init__(self, estimate: MapEstimate, excluded_positions: Sequence[int] = ()) -> None:
        self.size = estimate.residual.size
        columns = np.delete(
            np.concatenate([estimate.jacobian, np.diag(1 / estimate.prior_sd)]),
            list(excluded_positions),
            axis=1,
        )
        # The columns differ by many orders of magnitude; the projection depends only on their span.
        norm = np.linalg.norm(columns, axis=0)
        columns = columns[:, norm > 0] / norm[norm > 0]
        left_vectors, weights, _ = np.linalg.svd(columns, full_matrices=False)
        self.basis = left_vectors[:, weights > 1e-7]

    def remove_from(self, directions: np.ndarray) -> np.ndarray:
        """Return the remainder of whitened directions (k, size), with prior rows, (k, size + priors)."""
        rows = np.zeros((*directions.shape[:-1], self.basis.shape[0]))
        rows[..., : directions.shape[-1]] = directions
        return rows - (rows @ self.basis) @ self.basis.T


def stack_residual(problem: LibraryProblem, estimate: MapEstimate) -> np.ndarray:
    """Return the whitened residual and the deviations of the parameters from their priors, (size + priors,).

    A candidate can also explain the deviation of a parameter from its prior.
    """
    free = list(estimate.free)
    mean, _ = compute_priors(problem, free)
    return np.concatenate(
        [
            estimate.residual,
            (mean - transform_to_coordinates(problem, free, estimate.values)) / estimate.prior_sd,
        ]
    )


class _ResidualAtLimits:
    """Residual of a refit, fitted by amplitudes and by the parameters at their limits.

    A parameter at its limit cannot move beyond it, but it can move back. In a p-value it absorbs like all
    others: a stated value that is wrong by three standard deviations is no misfit.
    """

    def __init__(
        self, problem: LibraryProblem, estimate: MapEstimate, projection: NuisanceProjection
    ) -> None:
        at_limit = find_parameters_at_limit(problem, estimate)
        self.projection = NuisanceProjection(estimate, at_limit.tolist()) if at_limit.size else projection
        self.residual = stack_residual(problem, estimate)
        rows = np.concatenate([estimate.jacobian, np.diag(1 / estimate.prior_sd)]).T
        low, high = compute_limit_distances(problem, estimate)
        self.at_limit_rows, self.at_limit_distances = (
            self.projection.remove_from(rows[at_limit]),
            (low[at_limit], high[at_limit]),
        )
        self.chi2_reduction_at_limits = _fit_bounded_amplitudes(
            self.at_limit_rows, self.residual, *self.at_limit_distances
        )[1]

    def fit_amplitudes(
        self, directions: np.ndarray, low: np.ndarray, high: np.ndarray
    ) -> tuple[np.ndarray, float]:
        """Return the best amplitudes of some directions within their limits, and the reduction of χ²."""
        rows = np.concatenate([directions, self.at_limit_rows])
        limits = (np.concatenate(pair) for pair in zip((low, high), self.at_limit_distances, strict=True))
        amplitudes, chi2_reduction = _fit_bounded_amplitudes(rows, self.residual, *limits)
        return amplitudes[: len(directions)], chi2_reduction - self.chi2_reduction_at_limits


def compute_score_directions(
    problem: LibraryProblem,
    noise: NoiseModel,
    estimate: MapEstimate,
    candidates: Sequence[Candidate],
) -> list[ScoreDirection]:
    """Return the score direction of each candidate at a refit, with the χ² that it explains."""
    projection = NuisanceProjection(estimate)
    residual = _ResidualAtLimits(problem, estimate, projection)
    jacobians = _compute_candidate_jacobians(problem, estimate, candidates)
    return [
        _build_score_direction(problem, noise, estimate, candidate, jacobians[k], projection, residual)
        for k, candidate in enumerate(candidates)
    ]


def _compute_candidate_jacobians(
    problem: LibraryProblem, estimate: MapEstimate, candidates: Sequence[Candidate]
) -> dict[int, np.ndarray]:
    """Return the derivative of the prediction by each candidate's amplitudes, (k, 2, n), by position."""

    def compute_at_point(group: list[int]) -> dict[int, np.ndarray]:
        values = estimate.values
        for k in group:
            values = problem.set_shape(values, _get_reference_shape(candidates[k]))
        names = sorted({name for k in group for name in candidates[k].amplitudes})
        jacobian_by_name = dict(
            zip(names, problem.predict_with_jacobian(values, map(problem.index, names))[1], strict=True)
        )
        return {
            k: np.stack([jacobian_by_name[name] for name in candidates[k].amplitudes])
            * _compute_time_factor(problem, candidates[k])
            for k in group
        }

    points = parallel_map(compute_at_point, _group_candidates(problem, estimate, candidates))
    return {k: jacobian for point in points for k, jacobian in point.items()}


def _group_candidates(
    problem: LibraryProblem, estimate: MapEstimate, candidates: Sequence[Candidate]
) -> list[list[int]]:
    """Return groups of candidates whose derivatives are computed at one point.

    The shape parameters of a mechanism that is switched off do not influence the candidates of others.
    """
    single_groups, groups, active_ids = [], [], problem.find_active_mechanisms(estimate.values)
    for k, candidate in enumerate(candidates):
        has_shape = bool(_get_reference_shape(candidate))
        if has_shape and candidate.id in active_ids:
            single_groups.append([k])
            continue
        fits = (g for g in groups if all(_can_share_point(candidates[other], candidate) for other in g))
        group = next(fits, [])
        if not group:
            groups.append(group)
        group.append(k)
    return single_groups + groups


def _can_share_point(first: Candidate, second: Candidate) -> bool:
    """Return whether the shape of neither candidate changes the derivatives of the other."""
    if first.id != second.id:
        return True
    shape, other = _get_reference_shape(first), _get_reference_shape(second)
    agrees = all(shape[name] == other[name] for name in shape.keys() & other.keys())
    return shape == other or (agrees and not set(first.amplitudes) & set(second.amplitudes))


def _get_reference_shape(candidate: Candidate) -> dict[str, float]:
    """Return the shape at which the derivative of a candidate is computed."""
    course = TIME_COURSES.get(candidate.amplitudes[0])
    return course.reference_shape if course else candidate.shape


def _compute_time_factor(problem: LibraryProblem, candidate: Candidate) -> np.ndarray | float:
    """Return the factor from the derivative at the reference shape to that at the candidate's shape."""
    course, time = TIME_COURSES.get(candidate.amplitudes[0]), problem.case.recording.time
    if course is None or time is None:
        return 1.0
    return course.factor(time, candidate.shape) / course.factor(time, course.reference_shape)


def _build_score_direction(
    problem, noise, estimate, candidate, jacobian, projection: NuisanceProjection, residual: _ResidualAtLimits
) -> ScoreDirection:
    indices = [problem.index(name) for name in candidate.amplitudes]
    low, high = (
        problem.low[indices] - estimate.values[indices],
        problem.high[indices] - estimate.values[indices],
    )
    jacobian = np.nan_to_num(noise.whiten(jacobian))
    directions = projection.remove_from(jacobian)
    directions_at_limits = (
        directions if residual.projection is projection else residual.projection.remove_from(jacobian)
    )
    amplitudes, chi2_reduction = residual.fit_amplitudes(directions_at_limits, low, high)
    norm = np.linalg.norm(directions, axis=1)
    norm = np.where(norm > 0, norm, 1.0)
    return ScoreDirection(candidate, chi2_reduction, amplitudes, directions / norm[:, None], low < 0, norm)


def _fit_bounded_amplitudes(
    directions: np.ndarray, residual: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, float]:
    """Return the least-squares amplitudes within their limits and the reduction of χ².

    Without limits, a candidate with a weak effect could explain any misfit by an impossible amplitude.
    """
    amplitudes, norm = np.zeros(len(directions)), np.linalg.norm(directions, axis=1)
    is_usable = (norm > 1e-12) & (high > low)
    if not is_usable.any():
        return amplitudes, 0.0
    # Unit columns: amplitudes in newtons and pascals differ by many orders of magnitude.
    norm = norm[is_usable]
    orthonormal, triangle = np.linalg.qr((directions[is_usable] / norm[:, None]).T)
    solution = lsq_linear(
        triangle, orthonormal.T @ residual, (low[is_usable] * norm, high[is_usable] * norm), method="bvls"
    )
    amplitudes[is_usable] = solution.x / norm
    remaining = residual - amplitudes @ directions
    return amplitudes, float(residual @ residual - remaining @ remaining)
