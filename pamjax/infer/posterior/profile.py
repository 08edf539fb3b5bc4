"""Profile likelihood: the misfit as a function of one parameter.

    χ²(v) = min over the others of Σ (misfit / sd)² + Σ (their distance from their priors / prior sd)²

Priors of the other parameters are those of the posterior, including `--priors`; weights are those of the fit.
Form errors count as noise. The parameter's own prior is left out. Two parameters that act only in combination
have a flat profile, whatever the shape of the posterior.
"""

from __future__ import annotations

from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from pamjax.infer.fitting.covariance import compute_sd_and_correlation
from pamjax.infer.fitting.least_squares import Loss, Solution, solve_least_squares
from pamjax.infer.fitting.result import Fit
from pamjax.infer.form_errors.dataset_form import whiten_form_again
from pamjax.infer.problem.dataset import Dataset
from pamjax.infer.problem.parameter_space import ParameterSpace

#: A profile ends at this rise of χ², or at this distance from a bound (fraction of the range), or at a tenth
#: of the distance at the start if that is less.
_MAX_CHI2_RISE, _MIN_LIMIT_DISTANCE = 9.0, 0.005
#: Width of the prior that fixes a parameter, relative to its prior sd or step.
_FIXED_PRIOR_WIDTH = 1e-3
#: Rise of χ² at the ends of a 95 % interval.
CHI2_RISE_95 = 4.0


@dataclass(frozen=True, eq=False)
class LikelihoodProfile:
    """χ² along one parameter.

    Attributes:
        values: ascending, SI.
        rise: χ² above its minimum.
        low, high: values at which the rise is `CHI2_RISE_95`, SI; None if a bound comes first.
    """

    values: np.ndarray
    rise: np.ndarray
    low: float | None
    high: float | None


@dataclass(frozen=True, eq=False)
class ProfileProblem:
    """The least-squares problem of a fit with the priors of a posterior.

    Attributes:
        datasets: the recordings, with the weights of the fit.
        space: the muscle's parameters.
        loss: the loss of the fit.
        solution: its solution.
    """

    datasets: tuple[Dataset, ...]
    space: ParameterSpace
    loss: Loss
    solution: Solution

    @property
    def values(self) -> np.ndarray:
        """Return the parameters at the solution, (p,), SI."""
        return np.asarray(self.space.to_values(self.solution.u))


def build_profile_problem(fit: Fit, space: ParameterSpace) -> ProfileProblem:
    """Return the fit's problem with the priors of a posterior, whose first parameters are the fit's."""
    own_space = space.take_first(fit.space.size)
    datasets = tuple(map(_apply_variance_inflation, fit.datasets))
    is_inflated = any(d is not before for d, before in zip(datasets, fit.datasets, strict=True))
    if not is_inflated and all(
        np.array_equal(getattr(own_space, a), getattr(fit.space, a)) for a in ("low", "high", "mean", "sd")
    ):
        return ProfileProblem(fit.datasets, fit.space, fit.loss, fit.solution)
    values = dict(zip(own_space.names, np.asarray(fit.space.to_values(fit.solution.u)), strict=True))
    solution = solve_least_squares(
        datasets, own_space, own_space.move_inside_bounds(own_space.to_point(values)), fit.loss
    )
    return ProfileProblem(datasets, own_space, fit.loss, solution)


def _apply_variance_inflation(dataset: Dataset) -> Dataset:
    """Return the dataset with lower weights for systematic misfit, and no other inflation."""
    if dataset.whitening is None or float(dataset.whitening.variance_inflation) == 1.0:
        return dataset
    weight = 1 / jnp.sqrt(dataset.whitening.variance_inflation)
    inflated_dataset = eqx.tree_at(
        lambda d: (d.channel_weights, d.whitening.variance_inflation),
        dataset,
        (dataset.channel_weights * weight, jnp.asarray(1.0)),
    )
    return whiten_form_again(inflated_dataset)


def compute_profile(problem: ProfileProblem, name: str) -> LikelihoodProfile:
    """Return the profile of one parameter, followed from the best fit to both sides."""
    space, k, top = problem.space, problem.space.names.index(name), problem.solution.u
    step = float(min(_compute_sd_in_u(problem.solution)[k], 1.0))
    solutions = {0.0: _solve_with_fixed(problem, k, top)}
    for side in (-1.0, 1.0):
        u, steps = top, 0.5
        # A parameter may start close to the bound on this side.
        min_distance = min(
            _MIN_LIMIT_DISTANCE, 0.1 * _compute_distance_to_limit(space, k, float(top[k]), side)
        )
        while True:
            steps *= 2
            target = float(top[k]) + side * steps * step
            if _compute_distance_to_limit(space, k, target, side) < min_distance:
                break
            cost, profile_point = _solve_with_fixed(problem, k, u.at[k].set(target))
            # A failed solution is no evidence against the value: the profile ends.
            if not np.isfinite(cost):
                break
            solutions[side * steps], u = (cost, profile_point), profile_point
            if 2 * (cost - solutions[0.0][0]) > _MAX_CHI2_RISE:
                break
    positions = sorted(solutions)
    values = np.array([float(space.to_values(solutions[p][1])[k]) for p in positions])
    chi = 2 * np.array([solutions[p][0] for p in positions])
    rise = chi - chi.min()
    best = int(rise.argmin())
    low = _find_crossing(values[: best + 1][::-1], rise[: best + 1][::-1])
    return LikelihoodProfile(values, rise, low, _find_crossing(values[best:], rise[best:]))


def _compute_sd_in_u(solution: Solution) -> np.ndarray:
    """Return the standard deviations of the unbounded coordinates u at a solution, (p,)."""
    sd, _ = compute_sd_and_correlation(solution.total_information, solution.slope)
    slope = np.maximum(np.abs(np.asarray(solution.slope)), 1e-300)
    return np.where(np.isfinite(sd), sd / slope, 1.0)


def _solve_with_fixed(problem: ProfileProblem, k: int, u: Array) -> tuple[float, Array]:
    """Return half χ² with parameter k fixed at u[k], and the solution for the others."""
    space, solution = problem.space, problem.solution
    value, slope = space.to_values(u)[k], jnp.abs(solution.slope[k])
    sd = _FIXED_PRIOR_WIDTH * space.sd[k] if jnp.isfinite(space.sd[k]) else _FIXED_PRIOR_WIDTH * slope
    sd = jnp.minimum(sd, _FIXED_PRIOR_WIDTH * _compute_sd_in_u(solution)[k] * jnp.maximum(slope, 1e-300))
    fixed_space = eqx.tree_at(
        lambda s: (s.mean, s.sd), space, (space.mean.at[k].set(value), space.sd.at[k].set(sd))
    )
    fixed_solution = solve_least_squares(problem.datasets, fixed_space, u, problem.loss)
    return float(fixed_solution.cost), fixed_solution.u


def _compute_distance_to_limit(space: ParameterSpace, k: int, u: float, side: float) -> float:
    """Return the fraction of a parameter's range between it and the bound on one side."""
    return float(1 / (1 + np.exp(side * (space.origin[k] + u * space.width[k]))))


def _find_crossing(values: np.ndarray, rise: np.ndarray) -> float | None:
    """Return the value at which the rise exceeds `CHI2_RISE_95`, by linear interpolation of its root."""
    beyond = np.flatnonzero(rise > CHI2_RISE_95)
    if not beyond.size:
        return None
    k = int(beyond[0])
    inner, outer = np.sqrt(rise[k - 1]), np.sqrt(rise[k])
    fraction = (np.sqrt(CHI2_RISE_95) - inner) / (outer - inner)
    return float(values[k - 1] + (values[k] - values[k - 1]) * fraction)
