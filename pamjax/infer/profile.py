"""Profile likelihood: how badly the recording fits when one number is held elsewhere.

    χ²(v) = min over the others of Σ (misfit / sd)² + Σ (their distance from their priors)²

The number's own prior is left out: what remains is what the recording (and what is known of the others)
says of it. Two numbers that only act together give a flat profile, whatever the shape of the posterior.
"""

from __future__ import annotations

from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from pamjax.infer.fit import spread
from pamjax.infer.least_squares import solve
from pamjax.infer.result import Fit
from pamjax.infer.space import Space

#: A profile is followed until the misfit has risen by this much, or to within this share of a limit.
FAR, EDGE = 9.0, 0.005
#: A number is held by a prior this much narrower than its own step.
HELD = 1e-3
#: Rise of χ² at the ends of an interval of 95 %.
SURE = 4.0


@dataclass(frozen=True, eq=False)
class Profile:
    """χ² along one number.

    Attributes:
        values: rising, SI.
        rise: χ² above its least.
        low, high: where the rise is `SURE`, SI; None where a limit comes first.
    """

    values: np.ndarray
    rise: np.ndarray
    low: float | None
    high: float | None


def profile(fit: Fit, name: str) -> Profile:
    """Follow one number from the fit to both sides."""
    at, k = fit.space, fit.space.names.index(name)
    step = float(min(spread_in_u(fit)[k], 1.0))
    found = {0.0: _held(fit, k, fit.solution.u)}
    for side in (-1.0, 1.0):
        u, far = fit.solution.u, 0.5
        while True:
            far *= 2
            wanted = float(fit.solution.u[k]) + side * far * step
            if not EDGE < _share(at, k, wanted) < 1 - EDGE:
                break
            cost, u = found[side * far] = _held(fit, k, u.at[k].set(wanted))
            if 2 * (cost - found[0.0][0]) > FAR:
                break
    places = sorted(found)
    values = np.array([float(at.values(found[p][1])[k]) for p in places])
    chi = 2 * np.array([found[p][0] for p in places])
    rise = chi - chi.min()
    best = int(rise.argmin())
    low = _crossing(values[: best + 1][::-1], rise[: best + 1][::-1])
    return Profile(values, rise, low, _crossing(values[best:], rise[best:]))


def spread_in_u(fit: Fit) -> np.ndarray:
    """Standard deviations of the plain numbers u at the fit."""
    sd, _ = spread(fit.solution)
    slope = np.maximum(np.abs(np.asarray(fit.solution.slope)), 1e-300)
    return np.where(np.isfinite(sd), sd / slope, 1.0)


def _held(fit: Fit, k: int, u: Array) -> tuple[float, Array]:
    """Half χ² with number k held at u[k], and where the others went."""
    value = fit.space.values(u)[k]
    sd = HELD * fit.space.sd[k] if jnp.isfinite(fit.space.sd[k]) else HELD * jnp.abs(fit.solution.slope[k])
    sd = jnp.minimum(sd, HELD * spread_in_u(fit)[k] * jnp.maximum(jnp.abs(fit.solution.slope[k]), 1e-300))
    held = eqx.tree_at(
        lambda s: (s.mean, s.sd), fit.space, (fit.space.mean.at[k].set(value), fit.space.sd.at[k].set(sd))
    )
    found = solve(fit.members, held, u, fit.loss)
    return float(found.cost), found.u


def _share(at: Space, k: int, u: float) -> float:
    return float(1 / (1 + np.exp(-(at.origin[k] + u * at.width[k]))))


def _crossing(values: np.ndarray, rise: np.ndarray) -> float | None:
    """Where the rise passes `SURE` on the way out, by its root, which is straight for a parabola."""
    beyond = np.flatnonzero(rise > SURE)
    if not beyond.size:
        return None
    k = int(beyond[0])
    near, far = np.sqrt(rise[k - 1]), np.sqrt(rise[k])
    return float(values[k - 1] + (values[k] - values[k - 1]) * (np.sqrt(SURE) - near) / (far - near))
