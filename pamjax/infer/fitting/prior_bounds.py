"""Fit with stated values kept near their priors, for a recording that the model misses.

The limits are those of a diagnosis (`infer/problem/prior_limits.py`). A value beyond its limit is fixed there
by a narrow prior, and the others are fitted again. A fixed value is free again if its own prior would move it
inside.
"""

from __future__ import annotations

from collections.abc import Collection

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from pamjax.infer.fitting.least_squares import Loss, Solution, solve_least_squares
from pamjax.infer.problem.dataset import Dataset
from pamjax.infer.problem.parameter_space import ParameterSpace
from pamjax.infer.problem.prior_limits import compute_prior_limits

#: Width of the prior that fixes a value at its limit, relative to the width of its range.
_FIXED_WIDTH_SHARE = 1e-6
#: Maximum number of fits with another set of fixed values.
_MAX_LIMIT_ROUNDS = 10


def find_limits(space: ParameterSpace, names: Collection[str]) -> tuple[np.ndarray, np.ndarray]:
    """Return the limits of the values, (p,) each, SI; those of other names are their bounds."""
    low, high = np.asarray(space.low), np.asarray(space.high)
    is_limited = np.isin(space.names, list(names))
    limits = compute_prior_limits(space.names, (low, high), np.asarray(space.mean), np.asarray(space.sd))
    return np.where(is_limited, limits[0], low), np.where(is_limited, limits[1], high)


def solve_within_limits(
    datasets: tuple[Dataset, ...],
    space: ParameterSpace,
    start: Solution,
    limits: tuple[np.ndarray, np.ndarray],
    loss: Loss = "square",
) -> tuple[ParameterSpace, Solution]:
    """Return the solution within limits, and the space in which the values at their limits are fixed.

    Args:
        datasets: the recordings.
        space: the free parameters.
        start: the starting point.
        limits: (p,) lower and upper limits, SI.
        loss: the loss of the fit.
    """
    low, high = limits
    side, solution, fixed_space = np.zeros(space.size), start, space
    for _ in range(_MAX_LIMIT_ROUNDS):
        values = np.asarray(fixed_space.to_values(solution.u))
        is_inside = side * _compute_pull(space, fixed_space, values) < 0
        beyond = np.where(values < low, -1.0, 0.0) + np.where(values > high, 1.0, 0.0)
        new_side = np.where(side != 0, np.where(is_inside, 0.0, side), beyond)
        if np.array_equal(new_side, side) and solution is not start:
            break
        side = new_side
        fixed_space = _fix_values(space, side, low, high)
        start_values = np.where(side < 0, low, np.where(side > 0, high, values))
        point = space.to_point(dict(zip(space.names, start_values, strict=True)))
        solution = solve_least_squares(datasets, fixed_space, point, loss)
    return fixed_space, solution


def _fix_values(space: ParameterSpace, side: np.ndarray, low, high) -> ParameterSpace:
    """Return the space with a narrow prior at the lower (−1) or upper (1) limit of some values."""
    mean = np.where(side < 0, low, np.where(side > 0, high, np.asarray(space.mean)))
    sd = np.where(side != 0, _FIXED_WIDTH_SHARE * (high - low), np.asarray(space.sd))
    return eqx.tree_at(lambda s: (s.mean, s.sd), space, (jnp.asarray(mean), jnp.asarray(sd)))


def _compute_pull(space: ParameterSpace, fixed_space: ParameterSpace, values: np.ndarray) -> np.ndarray:
    """Return the force with which data and own prior pull a fixed value upwards."""
    narrow = (values - np.asarray(fixed_space.mean)) / np.asarray(fixed_space.sd) ** 2
    own = np.where(
        np.isfinite(np.asarray(space.sd)), (values - np.asarray(space.mean)) / np.asarray(space.sd) ** 2, 0.0
    )
    return narrow - own
