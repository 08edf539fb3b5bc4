"""The Gaussian that touches a posterior at its top, and the coordinates in which it is a unit ball.

The muscle's numbers and the noise's are independent in the expected curvature of a Gaussian likelihood:
the first is JᵀJ of the innovations, the second is known in closed form (`streams.py`), and the priors add
theirs. Scoring steps with that curvature find the top.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from pamjax.infer.posterior.log_density import Density, log_densities

#: Scoring steps at most, and the gain of log-density below which they end.
STEPS, SETTLED = 30, 1e-3
#: No direction is believed to be wider than this many prior sds: a start beyond would be a wall's.
WIDEST = 1.5


class Ball(eqx.Module):
    """A Gaussian, and the map u = centre + root x that makes it a unit ball.

    Attributes:
        centre: (p,) its mean, in u.
        root: (p, p) lower triangular root of its covariance.
    """

    centre: Float[Array, " p"]
    root: Float[Array, "p p"]

    def __call__(self, x: Float[Array, "*w p"]) -> Float[Array, "*w p"]:
        return self.centre + x @ self.root.T

    def back(self, u: Float[Array, " p"]) -> Float[Array, " p"]:
        return jax.scipy.linalg.solve_triangular(self.root, u - self.centre, lower=True)


@eqx.filter_jit
def curvature(density: Density, u: Float[Array, " p"]) -> tuple[Array, Array]:
    """Gradient and expected curvature of −log-density at u, (p,) and (p, p)."""
    at, values = density.at, density.at.values(u)

    def everything(v):
        pairs = zip(density.innovations(v), density.powers, strict=True)
        rows = [w * jnp.sqrt(p) for ws, ps in pairs for w, p in zip(ws, ps, strict=True)]
        return jnp.concatenate(rows), at.prior_residual(v), -density(v)

    by_mean, prior, gradient = jax.jacfwd(everything)(u)
    slope = jax.jvp(at.values, (u,), (jnp.ones_like(u),))[1]
    own = jnp.zeros(at.size, bool)
    noise = jnp.zeros((at.size, at.size))
    for streams, powers in zip(density.streams, density.powers, strict=True):
        for s, power in zip(streams, powers, strict=True):
            places = [s.sd] + [s.correlation] * (s.correlation >= 0)
            own = own.at[jnp.array(places)].set(True)
            scale = jnp.array([slope[s.sd] / values[s.sd], slope[s.correlation]])[: len(places)]
            block = s.information(values)[: len(places), : len(places)] * jnp.outer(scale, scale) * power
            noise = noise.at[jnp.ix_(jnp.array(places), jnp.array(places))].add(block)
    by_mean = jnp.where(own, 0.0, by_mean)
    # Half a logistic prior's curvature at its middle holds what is flat at its ends.
    flat = jnp.where(jnp.isfinite(at.sd), 0.0, at.width**2 / 8)
    total = by_mean.T @ by_mean + noise + prior.T @ prior + jnp.diag(flat)
    return gradient, total


def laplace(density: Density, start: Float[Array, " p"]) -> Ball:
    """Climb to the top near a start and put the Gaussian there."""
    u, best = start, float(log_densities(density, start[None])[0])
    for _ in range(STEPS):
        slope, total = curvature(density, u)
        step = -np.linalg.solve(_held(density, u, np.asarray(total)), np.asarray(slope))
        tries = u + jnp.asarray(0.5 ** np.arange(8))[:, None] * step
        found = np.asarray(log_densities(density, tries))
        k = int(np.nanargmax(np.where(np.isfinite(found), found, -np.inf)))
        gain = found[k] - best
        if not gain > 0:
            break
        u, best = tries[k], found[k]
        if gain < SETTLED:
            break
    _, total = curvature(density, u)
    return Ball(u, jnp.asarray(np.linalg.cholesky(np.linalg.inv(_held(density, u, np.asarray(total))))))


def _held(density: Density, u: Array, total: np.ndarray) -> np.ndarray:
    """The curvature with no direction wider than the prior, scaled so that it can be inverted."""
    at = density.at
    rate = np.asarray(jax.jvp(at.values, (jnp.zeros_like(u),), (jnp.ones_like(u),))[1])
    known = np.isfinite(np.asarray(at.sd))
    # A number anywhere between its limits is logistic in z, with standard deviation π / sqrt(3).
    prior = np.where(known, np.asarray(at.sd) / np.abs(rate), np.pi / np.sqrt(3) / np.asarray(at.width))
    return total + np.diag(1 / (WIDEST * 4 * prior) ** 2)
