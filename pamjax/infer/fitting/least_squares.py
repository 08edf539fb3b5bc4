"""Nonlinear least squares over named parameters, with the information of the data and of the priors.

The residuals are (measured − model) / sd of every sample, and (value − prior mean) / prior sd of every
parameter. The library optimistix minimises half their sum of squares by the Levenberg-Marquardt method.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from pamjax.compile.programs import run_compiled
from pamjax.infer.problem.dataset import Dataset
from pamjax.infer.problem.parameter_space import ParameterSpace

Loss = Literal["square", "soft"]

#: Maximum number of Levenberg-Marquardt steps; a fit usually needs about ten.
_MAX_LM_STEPS = 200


class Solution(eqx.Module):
    """Solution of a least-squares problem.

    Attributes:
        u: (p,) the point; see `parameter_space.py`.
        cost: half the sum of squared residuals, priors included.
        dataset_information: (d, p, p) JᵀJ of the measurements of each dataset, in u.
        information: (p, p) their sum, each over the variance inflation of its dataset.
        prior_information: (p, p) JᵀJ of the priors, in u.
        slope: (p,) d value / d u.
        steps: steps taken.
        converged: whether the minimiser converged.
    """

    u: Float[Array, " p"]
    cost: Array
    dataset_information: Float[Array, "d p p"]
    information: Float[Array, "p p"]
    prior_information: Float[Array, "p p"]
    slope: Float[Array, " p"]
    steps: Array
    converged: Array

    @property
    def total_information(self) -> Float[Array, "p p"]:
        """Return the information of data and priors."""
        return self.information + self.prior_information


class _LossName(eqx.Module):
    """The loss as an argument of a compiled program."""

    name: Loss = eqx.field(static=True)


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
    return Solution(*run_compiled(_solve, datasets, space, start, _LossName(loss)))


def _solve(
    datasets: tuple[Dataset, ...], space: ParameterSpace, start: Float[Array, " p"], loss: _LossName
) -> list[Array]:
    """Return the fields of the `Solution` of `solve_least_squares`: a program on disk has no classes."""
    # A program that is read from disk does not need the libraries.
    import lineax as lx
    import optimistix as optx

    # With many more rows than parameters, the normal equations are faster than a QR decomposition.
    solver = optx.LevenbergMarquardt(rtol=1e-9, atol=1e-9, linear_solver=lx.Normal(lx.Cholesky()))
    compute_residuals = _linearise_to_matrix(lambda u: _stack_all_residuals(datasets, space, u, loss.name))
    result = optx.least_squares(
        lambda u, _: compute_residuals(u), solver, start, max_steps=_MAX_LM_STEPS, throw=False
    )
    # The minimiser keeps residual and Jacobian of the point that it returns.
    last = result.state.f_info
    solution = _build_solution(datasets, space, result.value, last.residual, last.jac.as_matrix())
    converged = result.result == optx.RESULTS.successful
    return jax.tree.leaves(
        eqx.tree_at(lambda s: (s.steps, s.converged), solution, (result.stats["num_steps"], converged))
    )


def _linearise_to_matrix(function: Callable[[Array], Array]) -> Callable[[Array], Array]:
    """Return the function with its Jacobian matrix as linearisation.

    optimistix multiplies by the linearisation in several places. JAX's own one is the whole model each time,
    which is compiled and evaluated as often.
    """
    linearised = jax.custom_jvp(function)

    @linearised.defjvp
    def multiply(primals, tangents):
        value, jacobian = _compute_with_jacobian(function, *primals)
        return value, jacobian @ tangents[0]

    return linearised


def linearise_problem(
    datasets: tuple[Dataset, ...], space: ParameterSpace, u: Float[Array, " p"], loss: Loss = "square"
) -> Solution:
    """Return the `Solution` at a point, without a minimisation."""
    return Solution(*run_compiled(_linearise, datasets, space, u, _LossName(loss)))


def _linearise(
    datasets: tuple[Dataset, ...], space: ParameterSpace, u: Float[Array, " p"], loss: _LossName
) -> list[Array]:
    """Return the fields of the `Solution` of `linearise_problem`."""
    residuals, jacobian = _compute_with_jacobian(
        lambda v: _stack_all_residuals(datasets, space, v, loss.name), u
    )
    return jax.tree.leaves(_build_solution(datasets, space, u, residuals, jacobian))


def _stack_all_residuals(
    datasets: tuple[Dataset, ...], space: ParameterSpace, u: Float[Array, " p"], loss: Loss
) -> Array:
    """Return the residuals of `stack_residuals`, and then those of the priors."""
    return jnp.concatenate([stack_residuals(datasets, space, u, loss), space.compute_prior_residual(u)])


def _compute_with_jacobian(function: Callable[[Array], Array], u: Array) -> tuple[Array, Array]:
    """Return the value and the Jacobian matrix of a function."""

    def double(v):
        value = function(v)
        return value, value

    jacobian, value = jax.jacfwd(double, has_aux=True)(u)
    return value, jacobian


def _build_solution(
    datasets: tuple[Dataset, ...], space: ParameterSpace, u: Array, residuals: Array, jacobian: Array
) -> Solution:
    """Return the solution from all residuals and their Jacobian by u; zero steps, not converged."""
    ends = np.cumsum([2 * dataset.rows.pressure.size for dataset in datasets])
    *by_dataset, by_prior = jnp.split(jacobian, ends)
    dataset_information = jnp.stack([part.T @ part for part in by_dataset])
    return Solution(
        u=u,
        cost=0.5 * residuals @ residuals,
        dataset_information=dataset_information,
        information=_sum_information(dataset_information, datasets),
        prior_information=by_prior.T @ by_prior,
        slope=jax.jvp(space.to_values, (u,), (jnp.ones_like(u),))[1],
        steps=jnp.asarray(0),
        converged=jnp.asarray(False),
    )


def inflate_information(solution: Solution, datasets: tuple[Dataset, ...]) -> Solution:
    """Return the solution with the variance inflation of other datasets, which differ in nothing else."""
    information = _sum_information(solution.dataset_information, datasets)
    return eqx.tree_at(lambda s: s.information, solution, information)


def exchange_priors(solution: Solution, space: ParameterSpace, new_space: ParameterSpace) -> Solution:
    """Return the solution at the same point with other priors.

    Args:
        solution: the solution.
        space: the space of the solution.
        new_space: a space with other priors and the same coordinates.
    """
    residual = space.compute_prior_residual(solution.u)
    new_residual, jacobian = _compute_with_jacobian(new_space.compute_prior_residual, solution.u)
    cost = solution.cost + 0.5 * (new_residual @ new_residual - residual @ residual)
    return eqx.tree_at(lambda s: (s.cost, s.prior_information), solution, (cost, jacobian.T @ jacobian))


def _sum_information(dataset_information: Array, datasets: tuple[Dataset, ...]) -> Array:
    inflations = [
        1.0 if dataset.whitening is None else dataset.whitening.variance_inflation for dataset in datasets
    ]
    return jnp.tensordot(1 / jnp.stack([jnp.asarray(x) for x in inflations]), dataset_information, axes=1)
