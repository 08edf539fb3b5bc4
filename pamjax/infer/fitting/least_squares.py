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

from pamjax.infer.problem.dataset import Member
from pamjax.infer.problem.parameter_space import Space

Loss = Literal["square", "soft"]

#: Largest number of Levenberg-Marquardt steps; the paper's case takes about ten.
STEPS = 200


class Solution(eqx.Module):
    """Where a minimisation ended.

    Attributes:
        u: (p,) the point; see `space.py`.
        cost: half the sum of squared residuals, priors included.
        information: (p, p) JᵀJ of the measurements alone, in u.
        prior: (p, p) JᵀJ of the priors, in u.
        slope: (p,) d value / d u.
        steps: steps taken.
        converged: whether the minimiser says so.
    """

    u: Float[Array, " p"]
    cost: Array
    information: Float[Array, "p p"]
    prior: Float[Array, "p p"]
    slope: Float[Array, " p"]
    steps: Array
    converged: Array


def soften(r: Array) -> Array:
    """Residual whose square is 2 (sqrt(1 + r²) − 1): quadratic within one sd, linear far out."""
    return r / jnp.sqrt(0.5 * (1 + jnp.sqrt(1 + r**2)))


def residual(members: tuple[Member, ...], at: Space, u: Array, loss: Loss = "square") -> Array:
    """Every measurement's misfit over its standard deviation, all members in a row."""
    values = at.values(u)
    parts = []
    for member in members:
        for misfit, trust in zip(member.misfit(values), member.trust, strict=True):
            misfit = misfit if loss == "square" else soften(misfit)
            parts.append(misfit * trust * member.rows.used)
    return jnp.concatenate(parts)


@eqx.filter_jit
def solve(
    members: tuple[Member, ...], at: Space, start: Float[Array, " p"], loss: Loss = "square"
) -> Solution:
    """Minimise from a start.

    Args:
        members: the recordings.
        at: the numbers that may move.
        start: (p,) point to start from; zeros are the stated values.
        loss: "soft" lets a few samples be wrong.
    """

    def everything(u, _):
        return residual(members, at, u, loss), at.prior_residual(u)

    # Thousands of rows, a handful of numbers: the normal equations, not a QR of every row.
    solver = optx.LevenbergMarquardt(rtol=1e-9, atol=1e-9, linear_solver=lx.Normal(lx.Cholesky()))
    found = optx.least_squares(everything, solver, start, max_steps=STEPS, throw=False)
    ended = found.result == optx.RESULTS.successful
    return _around(members, at, found.value, loss, found.stats["num_steps"], ended)


@eqx.filter_jit
def linearise(members: tuple[Member, ...], at: Space, u: Float[Array, " p"]) -> Solution:
    """The `Solution` that a minimisation would return if it had ended here."""
    return _around(members, at, u, "square", jnp.asarray(0), jnp.asarray(False))


def _around(members, at: Space, u: Array, loss: Loss, steps: Array, converged: Array) -> Solution:
    def everything(v):
        return residual(members, at, v, loss), at.prior_residual(v)

    rows, priors = everything(u)
    by_data, by_prior = jax.jacfwd(everything)(u)
    return Solution(
        u=u,
        cost=0.5 * (rows @ rows + priors @ priors),
        information=by_data.T @ by_data,
        prior=by_prior.T @ by_prior,
        slope=jax.jvp(at.values, (u,), (jnp.ones_like(u),))[1],
        steps=steps,
        converged=converged,
    )
