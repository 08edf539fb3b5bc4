"""Maximum a posteriori estimate of the free parameters, with correlated noise and priors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any, cast

import numpy as np
from scipy.optimize import least_squares

from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.infer.noise.noise_model import NoiseModel
from pamjax.infer.problem.unit_diagonal import invert_scaled

#: Standard deviation that stands for a parameter without a prior.
UNINFORMATIVE_PRIOR_SD = 1e30

#: Range of a uniform variable in its standard deviations.
UNIFORM_RANGE_SD = 12**0.5


@dataclass(frozen=True, eq=False)
class MapEstimate:
    """Maximum a posteriori estimate of a refit.

    Attributes:
        free: indices of the free parameters.
        values: (p,) all parameter values, SI.
        chi2_with_priors: χ² of whitened residual and priors.
        chi2: χ² of the whitened residual alone.
        residual: (size,) whitened residual.
        jacobian: (size, k) derivative of the whitened prediction by the coordinates of the free parameters.
        prior_sd: (k,) sd of the priors in these coordinates.
        scale: (k,) derivative of value by coordinate.
    """

    free: tuple[int, ...]
    values: np.ndarray
    chi2_with_priors: float
    chi2: float
    residual: np.ndarray
    jacobian: np.ndarray
    prior_sd: np.ndarray
    scale: np.ndarray

    @property
    def covariance(self) -> np.ndarray:
        """Return the covariance of the free parameters, SI, (k, k)."""
        return self.compute_covariance()

    def compute_covariance(self, variance_inflation: float = 1.0) -> np.ndarray:
        """Return the covariance of the free parameters, SI, (k, k).

        Args:
            variance_inflation: factor on the variance of the samples; the priors keep theirs.
        """
        information = self.jacobian.T @ self.jacobian / variance_inflation + np.diag(1 / self.prior_sd**2)
        inverse, unit = invert_scaled(information)
        return inverse / np.outer(unit, unit) * np.outer(self.scale, self.scale)


def transform_to_coordinates(
    problem: LibraryProblem, indices: Sequence[int], values: np.ndarray
) -> np.ndarray:
    """Return the coordinates of values: the logarithm for parameters on a logarithmic scale."""
    chosen_values, log = values[list(indices)], problem.is_logarithmic[list(indices)]
    return np.where(log, np.log(np.where(log, chosen_values, 1.0)), chosen_values)


def compute_limit_distances(problem: LibraryProblem, estimate: MapEstimate) -> tuple[np.ndarray, np.ndarray]:
    """Return the distances of the free parameters to their lower and upper limits, in coordinates."""
    coordinates = transform_to_coordinates(problem, estimate.free, estimate.values)
    low, high = (
        transform_to_coordinates(problem, estimate.free, edge) - coordinates
        for edge in (problem.low, problem.high)
    )
    return np.minimum(low, 0.0), np.maximum(high, 0.0)


def find_parameters_at_limit(problem: LibraryProblem, estimate: MapEstimate) -> np.ndarray:
    """Return the positions in `estimate.free` of the parameters at a limit."""
    low, high = compute_limit_distances(problem, estimate)
    return np.flatnonzero(np.minimum(-low, high) < problem.settings.at_limit_range_share * (high - low))


def compute_priors(problem: LibraryProblem, indices: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and standard deviation of the priors in coordinates; infinite without a prior.

    A stated parameter has its stated value and sd. Other shape parameters and logarithmic parameters have
    their default value as mean. Their sd is the rms distance of that value to all values between their
    limits.
    """
    indices = list(indices)
    sd, log = problem.prior_sd[indices], problem.is_logarithmic[indices]
    is_shape = np.array([problem.meanings[k].neutral is None for k in indices], dtype=bool)
    start, low, high = (
        transform_to_coordinates(problem, indices, values)
        for values in (
            problem.start,
            np.where(problem.is_logarithmic, np.maximum(problem.low, 1e-300), problem.low),
            problem.high,
        )
    )
    is_uniform = ~np.isfinite(sd) & (log | is_shape)
    stated_sd = np.where(log, sd / np.where(log, problem.start[indices], 1.0), sd)
    with np.errstate(over="ignore"):
        rms_distance = np.hypot((high - low) / UNIFORM_RANGE_SD, start - (low + high) / 2)
    return start, np.where(is_uniform, rms_distance, stated_sd)


def fit_parameters(
    problem: LibraryProblem,
    noise: NoiseModel,
    free: Sequence[int],
    values: np.ndarray,
    max_evaluations: int | None = None,
) -> MapEstimate:
    """Return the maximum a posteriori estimate of some parameters.

    Args:
        problem: the recording and the library.
        noise: noise model.
        free: indices of the free parameters; the others are fixed.
        values: (p,) starting values, SI.
        max_evaluations: largest number of evaluations; the setting `max_refit_evaluations` if omitted.
    """
    free = list(free)
    mean, prior_sd = compute_priors(problem, free)
    low, high = (transform_to_coordinates(problem, free, edge) for edge in (problem.low, problem.high))
    evaluator = _ResidualEvaluator(problem, noise, free, values)

    def residuals(x):
        prior_residual = np.where(np.isfinite(prior_sd), (x - mean) / prior_sd, 0.0)
        return np.concatenate([evaluator(x).triangle[:, -1], prior_residual])

    def jacobian(x):
        return np.concatenate(
            [-evaluator(x).triangle[:, :-1], np.diag(np.where(np.isfinite(prior_sd), 1 / prior_sd, 0.0))]
        )

    width = np.where(np.isfinite(prior_sd), prior_sd, 0.1 * (high - low))
    # The minimiser is slow if it starts at a limit. A missing mechanism often drives baseline parameters to
    # their limits; with the mechanism they move back.
    inside = np.where(problem.is_baseline[free], problem.settings.start_limit_distance_share, 1e-6) * (
        high - low
    )
    start = np.clip(transform_to_coordinates(problem, free, values), low + inside, high - inside)
    solution = least_squares(
        residuals, start, jac=cast(Any, jacobian), bounds=(low, high), x_scale=width,
        ftol=1e-5, xtol=1e-7, gtol=1e-10, max_nfev=max_evaluations or problem.settings.max_refit_evaluations,
    )  # fmt: skip
    return evaluator.build_estimate(solution.x)


def evaluate_estimate(
    problem: LibraryProblem, noise: NoiseModel, free: Sequence[int], values: np.ndarray
) -> MapEstimate:
    """Return the estimate at given values, without a fit; arguments as in `fit_parameters`."""
    evaluator = _ResidualEvaluator(problem, noise, free, values)
    return evaluator.build_estimate(transform_to_coordinates(problem, free, values))


@dataclass(frozen=True, eq=False)
class _WhitenedEvaluation:
    values: np.ndarray
    scale: np.ndarray
    residual: np.ndarray
    jacobian: np.ndarray

    @cached_property
    def triangle(self) -> np.ndarray:
        """Return R of the QR decomposition of the Jacobian with the residual as last column, (k + 1, k + 1).

        Its columns have the lengths and angles of the originals, which is all that a minimiser uses.
        The minimiser decomposes k + 1 rows instead of thousands.
        """
        columns = np.column_stack([self.jacobian, self.residual])
        return np.asarray(np.linalg.qr(columns, mode="r")) if columns.shape[0] > columns.shape[1] else columns


class _ResidualEvaluator:
    """Residual and Jacobian at a point, evaluated once for both calls of the minimiser."""

    def __init__(
        self, problem: LibraryProblem, noise: NoiseModel, free: Sequence[int], values: np.ndarray
    ) -> None:
        self.problem, self.noise, self.free, self.values = problem, noise, list(free), values
        self.start = transform_to_coordinates(problem, self.free, values)
        self.point: np.ndarray | None = None
        self.evaluation: _WhitenedEvaluation | None = None

    def __call__(self, x: np.ndarray) -> _WhitenedEvaluation:
        if self.evaluation is None or self.point is None or not np.array_equal(self.point, x):
            log = self.problem.is_logarithmic[self.free]
            trial = self.values.copy()
            # Exactly the starting value, not exp(log(value)): the result there is often known.
            moved = np.where(log, np.exp(np.where(log, x, 0.0)), x)
            trial[self.free] = np.where(x == self.start, trial[self.free], moved)
            prediction, model_jacobian = self.problem.predict_with_jacobian(trial, self.free)
            scale = np.where(log, trial[self.free], 1.0)
            # A sample without a solution counts as a large misfit with zero derivative.
            residual = np.nan_to_num(self.noise.whiten(self.problem.measured - prediction), nan=1e3)
            jacobian = (np.nan_to_num(self.noise.whiten(model_jacobian)) * scale[:, None]).T
            self.point, self.evaluation = x.copy(), _WhitenedEvaluation(trial, scale, residual, jacobian)
        return self.evaluation

    def build_estimate(self, x: np.ndarray) -> MapEstimate:
        """Return the estimate at the coordinates x."""
        mean, prior_sd = compute_priors(self.problem, self.free)
        prior_residual = np.where(np.isfinite(prior_sd), (x - mean) / prior_sd, 0.0)
        evaluation = self(x)
        misfit = float(evaluation.residual @ evaluation.residual)
        return MapEstimate(
            free=tuple(self.free),
            values=evaluation.values,
            chi2_with_priors=misfit + float(prior_residual @ prior_residual),
            chi2=misfit,
            residual=evaluation.residual,
            jacobian=evaluation.jacobian,
            prior_sd=np.where(np.isfinite(prior_sd), prior_sd, UNINFORMATIVE_PRIOR_SD),
            scale=evaluation.scale,
        )
