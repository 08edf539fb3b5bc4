"""Nonlinear least squares over named parameters, with the information of the data and of the priors.

The residuals are (measured − model) / sd of every sample, and (value − prior mean) / prior sd of every
parameter. optimistix minimises half their sum of squares by the Levenberg-Marquardt method.
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
from pamjax.jit import compile_on_call

Loss = Literal["square", "soft"]

#: Maximum number of Levenberg-Marquardt steps; a fit usually needs about ten.
MAX_LM_STEPS = 200


class Solution(eqx.Module):
    """Solution of a least-squares problem.

    Attributes:
        u: (p,) the point; see `parameter_space.py`.
        cost: half the sum of squared residuals, priors included.
        information: (p, p) JᵀJ of the measurements alone over their variance inflation, in u.
        prior_information: (p, p) JᵀJ of the priors, in u.
        slope: (p,) d value / d u.
        steps: steps taken.
        converged: whether the minimiser converged.
    """

    u: Float[Array, " p"]
    cost: Array
    information: Float[Array, "p p"]
    prior_information: Float[Array, "p p"]
    slope: Float[Array, " p"]
    steps: Array
    converged: Array


def soften_residual(r: Array) -> Array:
    """Return the residual with the square 2 (sqrt(1 + r²) − 1): quadratic within one sd, then linear."""
    return r / jnp.sqrt(0.5 * (1 + jnp.sqrt(1 + r**2)))


def stack_residuals(
    datasets: tuple[Dataset, ...], space: ParameterSpace, u: Array, loss: Loss = "square"
) -> Array:
    """Return (measured − model) / sd of every sample, white if possible, for all datasets in one array."""
    values = space.to_values(u)
    parts = []
    for dataset in datasets:
        channels = [
            (misfit if loss == "square" else soften_residual(misfit)) * weight
            for misfit, weight in zip(
                dataset.compute_weighted_residuals(values), dataset.channel_weights, strict=True
            )
        ]
        parts.append(dataset.whiten_form_errors(jnp.concatenate(channels)))
    return jnp.concatenate(parts)


def _stack_inflations(datasets: tuple[Dataset, ...]) -> Array:
    """Return the variance inflation of every sample, in the order of `stack_residuals`."""
    return jnp.concatenate(
        [
            jnp.full(
                2 * dataset.rows.pressure.size,
                1.0 if dataset.whitening is None else dataset.whitening.variance_inflation,
            )
            for dataset in datasets
        ]
    )


def solve_least_squares(
    datasets: tuple[Dataset, ...], space: ParameterSpace, start: Float[Array, " p"], loss: Loss = "square"
) -> Solution:
    """Return the solution from a starting point.

    Args:
        datasets: the recordings.
        space: the free parameters.
        start: (p,) starting point in u; zeros are the stated values.
        loss: "square", or "soft", which reduces the weight of outliers.
    """
    u, steps, converged = _minimise(datasets, space, start, loss)
    # A program of its own: as a part of the minimiser it would be compiled twice.
    solution = linearise_problem(datasets, space, u, loss)
    return eqx.tree_at(lambda s: (s.steps, s.converged), solution, (steps, converged))


@compile_on_call
def _minimise(datasets: tuple[Dataset, ...], space: ParameterSpace, start: Array, loss: Loss):
    """Return the point, (p,), the number of steps, and whether the minimiser converged."""

    def compute_all_residuals(u, _):
        return stack_residuals(datasets, space, u, loss), space.compute_prior_residual(u)

    # With many more rows than parameters, the normal equations are faster than a QR decomposition.
    solver = optx.LevenbergMarquardt(rtol=1e-9, atol=1e-9, linear_solver=lx.Normal(lx.Cholesky()))
    result = optx.least_squares(compute_all_residuals, solver, start, max_steps=MAX_LM_STEPS, throw=False)
    return result.value, result.stats["num_steps"], result.result == optx.RESULTS.successful


@compile_on_call
def linearise_problem(
    datasets: tuple[Dataset, ...], space: ParameterSpace, u: Float[Array, " p"], loss: Loss = "square"
) -> Solution:
    """Return the `Solution` at a point, without a minimisation."""

    def compute_all_residuals(v):
        residuals = stack_residuals(datasets, space, v, loss), space.compute_prior_residual(v)
        return residuals, residuals

    (by_data, by_prior), (rows, priors) = jax.jacfwd(compute_all_residuals, has_aux=True)(u)
    return Solution(
        u=u,
        cost=0.5 * (rows @ rows + priors @ priors),
        information=(by_data / _stack_inflations(datasets)[:, None]).T @ by_data,
        prior_information=by_prior.T @ by_prior,
        slope=jax.jvp(space.to_values, (u,), (jnp.ones_like(u),))[1],
        steps=jnp.asarray(0),
        converged=jnp.asarray(False),
    )
