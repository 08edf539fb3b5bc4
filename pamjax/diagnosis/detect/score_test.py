"""What a mechanism would do to this recording, and how much of the misfit looks like it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import lsq_linear

from pamjax.compile.parallel import parallel_map
from pamjax.diagnosis.library.candidates import TIME_COURSES, Candidate
from pamjax.diagnosis.library.library_problem import COSTLIEST_MECHANISM, LibraryProblem
from pamjax.diagnosis.noise.estimate import NoiseModel
from pamjax.diagnosis.refit.least_squares import (
    MapEstimate,
    compute_limit_distances,
    compute_priors,
    find_parameters_at_limit,
    transform_to_coordinates,
)


@dataclass(frozen=True, eq=False)
class ScoreDirection:
    """A form before a recording.

    Attributes:
        candidate: which.
        chi2_reduction: χ² that its best amplitudes within their limits would take away, in the linear limit.
        amplitudes: those, SI.
        unit_vectors: (k, size) unit vectors, white, freed of what the numbers that move absorb.
        is_two_sided: (k,) whether an amplitude may be negative: friction drives nothing.
        norm: (k,) length of what is left of a direction, white, by its amplitude, SI; one where nothing is.
    """

    candidate: Candidate
    chi2_reduction: float
    amplitudes: np.ndarray
    unit_vectors: np.ndarray
    is_two_sided: np.ndarray
    norm: np.ndarray


class ProjectedOut:
    """What numbers that move absorb of a direction, under their priors: least squares with prior rows.

    Args:
        at: the refit.
        but: which of its numbers absorb nothing.
    """

    def __init__(self, estimate: MapEstimate, excluded: Sequence[int] = ()) -> None:
        self.size = estimate.residual.size
        stacked = np.delete(
            np.concatenate([estimate.jacobian, np.diag(1 / estimate.prior_sd)]), list(excluded), axis=1
        )
        # Columns differ by many orders of magnitude; only their span counts.
        norm = np.linalg.norm(stacked, axis=0)
        stacked = stacked[:, norm > 0] / norm[norm > 0]
        left, weights, _ = np.linalg.svd(stacked, full_matrices=False)
        self.basis = left[:, weights > 1e-7]

    def project_out(self, directions: np.ndarray) -> np.ndarray:
        """(k, size) white directions, with or without priors, as (k, size + priors) rows of what is left."""
        extended = np.zeros((*directions.shape[:-1], self.basis.shape[0]))
        extended[..., : directions.shape[-1]] = directions
        return extended - (extended @ self.basis) @ self.basis.T


def stack_residual(problem: LibraryProblem, estimate: MapEstimate) -> np.ndarray:
    """(size + priors,) what a refit leaves, white, and how far its numbers are from what is believed of them.

    What a form relieves a strained ruler of is part of what it explains.
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
    """What a refit leaves, and what may explain it: amplitudes, and numbers that were driven to their limits.

    Such a number absorbs nothing of what would drive it further, and may come back. (In a p-value it absorbs
    as all others do: that a lab was wrong by three standard deviations is no mismatch.)
    """

    def __init__(self, problem: LibraryProblem, estimate: MapEstimate, projected_out: ProjectedOut) -> None:
        at_limit = find_parameters_at_limit(problem, estimate)
        self.projected_out = ProjectedOut(estimate, at_limit.tolist()) if at_limit.size else projected_out
        self.residual = stack_residual(problem, estimate)
        stacked = np.concatenate([estimate.jacobian, np.diag(1 / estimate.prior_sd)]).T
        low, high = compute_limit_distances(problem, estimate)
        self.at_limit_rows, self.at_limit_distances = (
            self.projected_out.project_out(stacked[at_limit]),
            (low[at_limit], high[at_limit]),
        )
        self.chi2_reduction_at_limits = _fit_bounded_amplitudes(
            self.at_limit_rows, self.residual, *self.at_limit_distances
        )[1]

    def fit_amplitudes(self, free: np.ndarray, low: np.ndarray, high: np.ndarray) -> tuple[np.ndarray, float]:
        """Best amplitudes of what is not absorbed, within their limits, and the χ² that they take away."""
        rows = np.concatenate([free, self.at_limit_rows])
        limits = (np.concatenate(pair) for pair in zip((low, high), self.at_limit_distances, strict=True))
        amplitudes, chi2_reduction = _fit_bounded_amplitudes(rows, self.residual, *limits)
        return amplitudes[: len(free)], chi2_reduction - self.chi2_reduction_at_limits


def compute_score_directions(
    problem: LibraryProblem, noise: NoiseModel, estimate: MapEstimate, candidates: Sequence[Candidate]
) -> list[ScoreDirection]:
    """The signature of each form at a refit, and how much of its residual it would explain."""
    projected_out = ProjectedOut(estimate)
    residual = _ResidualAtLimits(problem, estimate, projected_out)
    jacobians = _compute_jacobians(problem, estimate, candidates)
    return [
        _build_score_direction(problem, noise, estimate, candidate, jacobians[k], projected_out, residual)
        for k, candidate in enumerate(candidates)
    ]


def _compute_jacobians(
    problem: LibraryProblem, estimate: MapEstimate, candidates: Sequence[Candidate]
) -> dict[int, np.ndarray]:
    """Derivative of what the bench shows by each form's amplitudes, (k, 2, n), in few sweeps."""

    def compute_at_point(group: list[int]) -> dict[int, np.ndarray]:
        values = estimate.values.copy()
        for k in group:
            for name, value in _get_reference_shape(candidates[k]).items():
                index = problem.index(name)
                values[index] = np.clip(value, problem.low[index], problem.high[index])
        names = sorted({name for k in group for name in candidates[k].amplitudes})
        jacobian_by_name = dict(
            zip(names, problem.jacobian(values, map(problem.index, names))[1], strict=True)
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
    """Which forms' derivatives are taken at one point: what is switched off has no shape for others."""
    single_groups, points, active_ids = [], [], problem.active(estimate.values)
    for k, candidate in enumerate(candidates):
        shape = _get_reference_shape(candidate)
        if candidate.id == COSTLIEST_MECHANISM or (shape and candidate.id in active_ids):
            single_groups.append([k])
            continue
        fits = (p for p in points if all(p[1].get(name, value) == value for name, value in shape.items()))
        group, shapes = next(fits, ([], {}))
        if not group:
            points.append((group, shapes))
        group.append(k)
        shapes.update(shape)
    return single_groups + [group for group, _ in points]


def _get_reference_shape(candidate: Candidate) -> dict[str, float]:
    """The shape at which a form's derivative is taken."""
    course = TIME_COURSES.get(candidate.amplitudes[0])
    return course.reference_shape if course else candidate.shape


def _compute_time_factor(problem: LibraryProblem, candidate: Candidate) -> np.ndarray | float:
    """What the derivative there is to be multiplied with for this form's own shape."""
    course, time = TIME_COURSES.get(candidate.amplitudes[0]), problem.case.recording.time
    if course is None or time is None:
        return 1.0
    return course.factor(time, candidate.shape) / course.factor(time, course.reference_shape)


def _build_score_direction(
    problem, noise, estimate, candidate, jacobian, projected_out: ProjectedOut, residual: _ResidualAtLimits
) -> ScoreDirection:
    indices = [problem.index(name) for name in candidate.amplitudes]
    low, high = (
        problem.low[indices] - estimate.values[indices],
        problem.high[indices] - estimate.values[indices],
    )
    jacobian = np.nan_to_num(noise.whiten(jacobian))
    free = projected_out.project_out(jacobian)
    free_at_limits = (
        free if residual.projected_out is projected_out else residual.projected_out.project_out(jacobian)
    )
    amplitudes, chi2_reduction = residual.fit_amplitudes(free_at_limits, low, high)
    norm = np.linalg.norm(free, axis=1)
    norm = np.where(norm > 0, norm, 1.0)
    return ScoreDirection(candidate, chi2_reduction, amplitudes, free / norm[:, None], low < 0, norm)


def _fit_bounded_amplitudes(
    free: np.ndarray, residual: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, float]:
    """Amplitudes of least squares within their limits, and the χ² they take away.

    Without limits a form that hardly shows here explains anything, by an amplitude that no muscle has.
    """
    amplitudes, norm = np.zeros(len(free)), np.linalg.norm(free, axis=1)
    kept = (norm > 1e-12) & (high > low)
    if not kept.any():
        return amplitudes, 0.0
    # Columns of length one: newtons and pascals are many orders of magnitude apart.
    norm = norm[kept]
    axes, across = np.linalg.qr((free[kept] / norm[:, None]).T)
    solution = lsq_linear(across, axes.T @ residual, (low[kept] * norm, high[kept] * norm), method="bvls")
    amplitudes[kept] = solution.x / norm
    remaining = residual - amplitudes @ free
    return amplitudes, float(residual @ residual - remaining @ remaining)
