"""Maximum a posteriori estimate of the free parameters, with correlated noise and priors."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np

from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.secant_minimiser import minimise_least_squares
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
        evaluate_jacobian: returns `jacobian`.
        prior_sd: (k,) sd of the priors in the coordinates of the free parameters.
        scale: (k,) derivative of value by coordinate.
    """

    free: tuple[int, ...]
    values: np.ndarray
    chi2_with_priors: float
    chi2: float
    residual: np.ndarray
    evaluate_jacobian: Callable[[], np.ndarray]
    prior_sd: np.ndarray
    scale: np.ndarray

    @cached_property
    def jacobian(self) -> np.ndarray:
        """Return the derivative of the whitened prediction by the coordinates, (size, k).

        It is computed when it is first needed: most estimates are only compared by their χ².
        """
        return self.evaluate_jacobian()

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
    is_rough: bool = False,
) -> MapEstimate:
    """Return the maximum a posteriori estimate of some parameters.

    Args:
        problem: the recording and the library.
        noise: noise model.
        free: indices of the free parameters; the others are fixed.
        values: (p,) starting values, SI.
        max_evaluations: largest number of evaluations; the setting `max_refit_evaluations` if omitted.
        is_rough: whether it ends at a larger tolerance, and without a Jacobian that confirms the minimum.
    """
    free = list(free)
    mean, prior_sd = compute_priors(problem, free)
    low, high = (transform_to_coordinates(problem, free, edge) for edge in (problem.low, problem.high))
    evaluator = _ResidualEvaluator(problem, noise, free, values)
    is_informative = np.isfinite(prior_sd)
    prior_jacobian = np.diag(np.where(is_informative, 1 / prior_sd, 0.0))

    def add_priors(x: np.ndarray, residual: np.ndarray) -> np.ndarray:
        return np.concatenate([residual, np.where(is_informative, (x - mean) / prior_sd, 0.0)])

    def evaluate(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        residual, jacobian = evaluator.evaluate(x)
        return add_priors(x, residual), np.concatenate([-jacobian, prior_jacobian])

    width = np.where(np.isfinite(prior_sd), prior_sd, 0.1 * (high - low))
    # The minimiser is slow if it starts at a limit. A missing mechanism often drives baseline parameters to
    # their limits; with the mechanism they move back.
    inside = np.where(problem.is_baseline[free], problem.settings.start_limit_distance_share, 1e-6) * (
        high - low
    )
    start = np.clip(transform_to_coordinates(problem, free, values), low + inside, high - inside)
    solution = minimise_least_squares(
        evaluate,
        lambda x: add_priors(x, evaluator.compute_residual(x)),
        start,
        (low, high),
        width,
        max_evaluations or problem.settings.max_refit_evaluations,
        is_rough,
    )
    return evaluator.build_estimate(solution)


def evaluate_estimate(
    problem: LibraryProblem, noise: NoiseModel, free: Sequence[int], values: np.ndarray
) -> MapEstimate:
    """Return the estimate at given values, without a fit; arguments as in `fit_parameters`."""
    evaluator = _ResidualEvaluator(problem, noise, free, values)
    return evaluator.build_estimate(transform_to_coordinates(problem, free, values))


class _ResidualEvaluator:
    """Whitened residual and Jacobian by coordinates; those of the last point are kept."""

    def __init__(
        self, problem: LibraryProblem, noise: NoiseModel, free: Sequence[int], values: np.ndarray
    ) -> None:
        self.problem, self.noise, self.free, self.values = problem, noise, list(free), values
        self.start = transform_to_coordinates(problem, self.free, values)
        self.point: np.ndarray | None = None
        self.evaluation: tuple[np.ndarray, np.ndarray] | None = None

    def evaluate(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the residual, (size,), and the derivatives of the prediction, (size, k)."""
        if self.evaluation is None or not self._is_at(x):
            values = self._set_values(x)
            prediction, model_jacobian = self.problem.predict_with_jacobian(values, self.free)
            jacobian = np.nan_to_num(self.noise.whiten(model_jacobian)) * self._compute_scale(values)[:, None]
            self.point, self.evaluation = x.copy(), (self._whiten_residual(prediction), jacobian.T)
        return self.evaluation

    def compute_residual(self, x: np.ndarray) -> np.ndarray:
        """Return the residual alone."""
        if self.evaluation is not None and self._is_at(x):
            return self.evaluation[0]
        return self._whiten_residual(self.problem.predict(self._set_values(x)))

    def compute_jacobian(self, x: np.ndarray) -> np.ndarray:
        """Return the derivatives of the prediction alone."""
        return self.evaluate(x)[1]

    def build_estimate(self, x: np.ndarray) -> MapEstimate:
        """Return the estimate at the coordinates x."""
        mean, prior_sd = compute_priors(self.problem, self.free)
        prior_residual = np.where(np.isfinite(prior_sd), (x - mean) / prior_sd, 0.0)
        residual, values = self.compute_residual(x), self._set_values(x)
        misfit = float(residual @ residual)
        return MapEstimate(
            free=tuple(self.free),
            values=values,
            chi2_with_priors=misfit + float(prior_residual @ prior_residual),
            chi2=misfit,
            residual=residual,
            evaluate_jacobian=partial(self.compute_jacobian, x),
            prior_sd=np.where(np.isfinite(prior_sd), prior_sd, UNINFORMATIVE_PRIOR_SD),
            scale=self._compute_scale(values),
        )

    def _is_at(self, x: np.ndarray) -> bool:
        """Return whether the kept results are those of the coordinates x."""
        return self.point is not None and np.array_equal(self.point, x)

    def _set_values(self, x: np.ndarray) -> np.ndarray:
        log, values = self.problem.is_logarithmic[self.free], self.values.copy()
        # Exactly the starting value, not exp(log(value)): the result there is often known.
        moved = np.where(log, np.exp(np.where(log, x, 0.0)), x)
        values[self.free] = np.where(x == self.start, values[self.free], moved)
        return values

    def _compute_scale(self, values: np.ndarray) -> np.ndarray:
        """Return the derivative of value by coordinate, (k,)."""
        return np.where(self.problem.is_logarithmic[self.free], values[self.free], 1.0)

    def _whiten_residual(self, prediction: np.ndarray) -> np.ndarray:
        # A sample without a solution counts as a large misfit with zero derivative.
        return np.nan_to_num(self.noise.whiten(self.problem.measured - prediction), nan=1e3)
