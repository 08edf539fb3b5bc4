"""Laplace approximation of a posterior, and coordinates in which it is a standard normal distribution.

In the Fisher information of a Gaussian likelihood, parameters of the muscle and of the noise are independent.
The first block is JᵀJ of the innovations; the second has a closed form (`ar1_likelihood.py`). The priors add
their curvature. Fisher scoring with this matrix gives the mode.

Form errors add their estimated coefficients to the residuals of the first block. Its JᵀJ is then the
information after the coefficients are integrated out.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from pamjax.infer.posterior.log_density import PosteriorDensity, compute_log_densities
from pamjax.jit import compile_on_call

#: Maximum number of scoring steps, and the gain of log-density at which they stop.
_MAX_SCORING_STEPS, _LOG_DENSITY_TOLERANCE = 30, 1e-3
#: Maximum sd of the approximation, in prior sds: wider starting points would be close to the bounds.
_MAX_WIDTH_IN_PRIOR_SD = 1.5


class GaussianApproximation(eqx.Module):
    """A Gaussian approximation, and the map u = centre + root x from standard normal x.

    Attributes:
        centre: (p,) its mean, in u.
        covariance_root: (p, p) lower triangular root of its covariance.
    """

    centre: Float[Array, " p"]
    covariance_root: Float[Array, "p p"]

    def __call__(self, x: Float[Array, "*w p"]) -> Float[Array, "*w p"]:
        return self.centre + x @ self.covariance_root.T

    def whiten(self, u: Float[Array, " p"]) -> Float[Array, " p"]:
        return jax.scipy.linalg.solve_triangular(self.covariance_root, u - self.centre, lower=True)


@compile_on_call
def _compute_curvature(density: PosteriorDensity, u: Float[Array, " p"]) -> tuple[Array, Array]:
    """Return gradient and expected curvature of −log-density at u, (p,) and (p, p)."""
    space, values = density.space, density.space.to_values(u)

    def compute_all(v):
        innovations, coefficients = density.compute_innovations(v)
        pairs = zip(innovations, density.powers, strict=True)
        rows = [w * jnp.sqrt(p) for ws, ps in pairs for w, p in zip(ws, ps, strict=True)]
        return jnp.concatenate([*rows, *coefficients]), space.compute_prior_residual(v), -density(v)

    by_mean, prior, gradient = jax.jacfwd(compute_all)(u)
    slope = jax.jvp(space.to_values, (u,), (jnp.ones_like(u),))[1]
    is_noise = jnp.zeros(space.size, bool)
    noise = jnp.zeros((space.size, space.size))
    for likelihoods, powers in zip(density.likelihoods, density.powers, strict=True):
        for s, power in zip(likelihoods, powers, strict=True):
            indices = [s.sd_index] + [s.correlation_index] * (s.correlation_index >= 0)
            is_noise = is_noise.at[jnp.array(indices)].set(True)
            scale = jnp.array([slope[s.sd_index] / values[s.sd_index], slope[s.correlation_index]])[
                : len(indices)
            ]
            block = (
                s.compute_information(values)[: len(indices), : len(indices)]
                * jnp.outer(scale, scale)
                * power
            )
            noise = noise.at[jnp.ix_(jnp.array(indices), jnp.array(indices))].add(block)
    by_mean = jnp.where(is_noise, 0.0, by_mean)
    # Half the curvature of a logistic prior at its middle: the prior itself is flat near its bounds.
    flat = jnp.where(jnp.isfinite(space.sd), 0.0, space.width**2 / 8)
    total = by_mean.T @ by_mean + noise + prior.T @ prior + jnp.diag(flat)
    return gradient, total


def fit_laplace(density: PosteriorDensity, start: Float[Array, " p"]) -> GaussianApproximation:
    """Return the Gaussian approximation at the mode near a starting point."""
    u, best = start, float(compute_log_densities(density, start[None])[0])
    for _ in range(_MAX_SCORING_STEPS):
        slope, total = _compute_curvature(density, u)
        step = -np.linalg.solve(_limit_width(density, u, np.asarray(total)), np.asarray(slope))
        candidates = u + jnp.asarray(0.5 ** np.arange(8))[:, None] * step
        log_densities = np.asarray(compute_log_densities(density, candidates))
        k = int(np.nanargmax(np.where(np.isfinite(log_densities), log_densities, -np.inf)))
        gain = log_densities[k] - best
        if not gain > 0:
            break
        u, best = candidates[k], log_densities[k]
        if gain < _LOG_DENSITY_TOLERANCE:
            break
    _, total = _compute_curvature(density, u)
    return GaussianApproximation(
        u, jnp.asarray(np.linalg.cholesky(np.linalg.inv(_limit_width(density, u, np.asarray(total)))))
    )


def _limit_width(density: PosteriorDensity, u: Array, total: np.ndarray) -> np.ndarray:
    """Return the curvature plus a small multiple of the prior's, so that it can be inverted."""
    space = density.space
    rate = np.asarray(jax.jvp(space.to_values, (jnp.zeros_like(u),), (jnp.ones_like(u),))[1])
    is_gaussian = np.isfinite(np.asarray(space.sd))
    # A uniform prior is logistic in z, with standard deviation π / sqrt(3).
    prior = np.where(
        is_gaussian, np.asarray(space.sd) / np.abs(rate), np.pi / np.sqrt(3) / np.asarray(space.width)
    )
    return total + np.diag(1 / (_MAX_WIDTH_IN_PRIOR_SD * 4 * prior) ** 2)
