"""Least squares over named numbers: one compiled program solves, and says how well it knows.

The residual is every misfit over its standard deviation, and every (value − prior) over its own.
Optimistix does the minimising.
"""

from __future__ import annotations

from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import lineax as lx
import optimistix as optx
from jaxtyping import Array, Float

from pamjax.infer.problem.dataset import Dataset
from pamjax.infer.problem.parameter_space import ParameterSpace

Loss = Literal["square", "soft"]

#: Largest number of Levenberg-Marquardt steps; the paper's case takes about ten.
MAX_LM_STEPS = 200


class Solution(eqx.Module):
    """Where a minimisation ended.

    Attributes:
        u: (p,) the point; see `parameter_space.py`.
        cost: half the sum of squared residuals, priors included.
        information: (p, p) JᵀJ of the measurements alone, in u.
        prior_information: (p, p) JᵀJ of the priors, in u.
        slope: (p,) d value / d u.
        steps: steps taken.
        converged: whether the minimiser says so.
    """

    u: Float[Array, " p"]
    cost: Array
    information: Float[Array, "p p"]
    prior_information: Float[Array, "p p"]
    slope: Float[Array, " p"]
    steps: Array
    converged: Array


def soften_residual(r: Array) -> Array:
    """Residual whose square is 2 (sqrt(1 + r²) − 1): quadratic within one sd, linear far out."""
    return r / jnp.sqrt(0.5 * (1 + jnp.sqrt(1 + r**2)))


def stack_residuals(
    datasets: tuple[Dataset, ...], space: ParameterSpace, u: Array, loss: Loss = "square"
) -> Array:
    """Every measurement's misfit over its standard deviation, all members in a row."""
    values = space.to_values(u)
    parts = []
    for dataset in datasets:
        for misfit, weight in zip(
            dataset.compute_standardised_residuals(values), dataset.channel_weights, strict=True
        ):
            misfit = misfit if loss == "square" else soften_residual(misfit)
            parts.append(misfit * weight * dataset.rows.training_mask)
    return jnp.concatenate(parts)


@eqx.filter_jit
def solve_least_squares(
    datasets: tuple[Dataset, ...], space: ParameterSpace, start: Float[Array, " p"], loss: Loss = "square"
) -> Solution:
    """Minimise from a start.

    Args:
        datasets: the recordings.
        space: the numbers that may move.
        start: (p,) point to start from; zeros are the stated values.
        loss: "soft" lets a few samples be wrong.
    """

    def compute_all_residuals(u, _):
        return stack_residuals(datasets, space, u, loss), space.compute_prior_residual(u)

    # Thousands of rows, a handful of numbers: the normal equations, not a QR of every row.
    solver = optx.LevenbergMarquardt(rtol=1e-9, atol=1e-9, linear_solver=lx.Normal(lx.Cholesky()))
    result = optx.least_squares(compute_all_residuals, solver, start, max_steps=MAX_LM_STEPS, throw=False)
    successful = result.result == optx.RESULTS.successful
    return _build_solution(datasets, space, result.value, loss, result.stats["num_steps"], successful)


@eqx.filter_jit
def linearise_problem(
    datasets: tuple[Dataset, ...], space: ParameterSpace, u: Float[Array, " p"]
) -> Solution:
    """The `Solution` that a minimisation would return if it had ended here."""
    return _build_solution(datasets, space, u, "square", jnp.asarray(0), jnp.asarray(False))


def _build_solution(
    datasets, space: ParameterSpace, u: Array, loss: Loss, steps: Array, converged: Array
) -> Solution:
    def compute_all_residuals(v):
        return stack_residuals(datasets, space, v, loss), space.compute_prior_residual(v)

    rows, priors = compute_all_residuals(u)
    by_data, by_prior = jax.jacfwd(compute_all_residuals)(u)
    return Solution(
        u=u,
        cost=0.5 * (rows @ rows + priors @ priors),
        information=by_data.T @ by_data,
        prior_information=by_prior.T @ by_prior,
        slope=jax.jvp(space.to_values, (u,), (jnp.ones_like(u),))[1],
        steps=steps,
        converged=converged,
    )
