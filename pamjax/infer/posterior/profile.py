"""Profile likelihood: how badly the recording fits when one number is held elsewhere.

    χ²(v) = min over the others of Σ (misfit / sd)² + Σ (their distance from their priors)²

The others' priors are those of the posterior, `--priors` among them, and samples weigh as in its fit. The
number's own prior is left out: what remains is what the recording (and what is known of the others)
says of it. Two numbers that only act together give a flat profile, whatever the shape of the posterior.
"""

from __future__ import annotations

from dataclasses import dataclass

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from pamjax.infer.fitting.fit import spread
from pamjax.infer.fitting.least_squares import Loss, Solution, solve
from pamjax.infer.fitting.result import Fit
from pamjax.infer.problem.dataset import Member
from pamjax.infer.problem.parameter_space import Space

#: A profile is followed until the misfit has risen by this much, or to within this share of a limit, or
#: to a tenth of what is left there if that is less.
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


@dataclass(frozen=True, eq=False)
class Problem:
    """A fit's least squares under a posterior's priors.

    Attributes:
        members: the recordings, weighed as in the fit.
        at: the muscle's numbers.
        loss: the fit's.
        solution: where it ends.
    """

    members: tuple[Member, ...]
    at: Space
    loss: Loss
    solution: Solution

    @property
    def values(self) -> np.ndarray:
        """(p,) the numbers where it ends, SI."""
        return np.asarray(self.at.values(self.solution.u))


def believing(fit: Fit, at: Space) -> Problem:
    """The fit's problem under the priors of a posterior, whose first numbers are the fit's."""
    own = at.first(fit.space.size)
    if all(np.array_equal(getattr(own, a), getattr(fit.space, a)) for a in ("low", "high", "mean", "sd")):
        return Problem(fit.members, fit.space, fit.loss, fit.solution)
    values = dict(zip(own.names, np.asarray(fit.space.values(fit.solution.u)), strict=True))
    ended = solve(fit.members, own, own.inside(own.point(values)), fit.loss)
    return Problem(fit.members, own, fit.loss, ended)


def profile(problem: Problem, name: str) -> Profile:
    """Follow one number from the best fit to both sides."""
    at, k, top = problem.at, problem.at.names.index(name), problem.solution.u
    step = float(min(spread_in_u(problem.solution)[k], 1.0))
    found = {0.0: _held(problem, k, top)}
    for side in (-1.0, 1.0):
        u, far = top, 0.5
        # Towards the limit on this side; a number may begin close to one.
        least = min(EDGE, 0.1 * _room(at, k, float(top[k]), side))
        while True:
            far *= 2
            wanted = float(top[k]) + side * far * step
            if _room(at, k, wanted, side) < least:
                break
            cost, near = _held(problem, k, u.at[k].set(wanted))
            # Beyond lies a muscle without a solution, which is no evidence against the number.
            if not np.isfinite(cost):
                break
            found[side * far], u = (cost, near), near
            if 2 * (cost - found[0.0][0]) > FAR:
                break
    places = sorted(found)
    values = np.array([float(at.values(found[p][1])[k]) for p in places])
    chi = 2 * np.array([found[p][0] for p in places])
    rise = chi - chi.min()
    best = int(rise.argmin())
    low = _crossing(values[: best + 1][::-1], rise[: best + 1][::-1])
    return Profile(values, rise, low, _crossing(values[best:], rise[best:]))


def spread_in_u(solution: Solution) -> np.ndarray:
    """Standard deviations of the plain numbers u at a solution."""
    sd, _ = spread(solution)
    slope = np.maximum(np.abs(np.asarray(solution.slope)), 1e-300)
    return np.where(np.isfinite(sd), sd / slope, 1.0)


def _held(problem: Problem, k: int, u: Array) -> tuple[float, Array]:
    """Half χ² with number k held at u[k], and where the others went."""
    at, solution = problem.at, problem.solution
    value, slope = at.values(u)[k], jnp.abs(solution.slope[k])
    sd = HELD * at.sd[k] if jnp.isfinite(at.sd[k]) else HELD * slope
    sd = jnp.minimum(sd, HELD * spread_in_u(solution)[k] * jnp.maximum(slope, 1e-300))
    held = eqx.tree_at(lambda s: (s.mean, s.sd), at, (at.mean.at[k].set(value), at.sd.at[k].set(sd)))
    found = solve(problem.members, held, u, problem.loss)
    return float(found.cost), found.u


def _room(at: Space, k: int, u: float, side: float) -> float:
    """Share of a number's range that is left on one side of it."""
    return float(1 / (1 + np.exp(side * (at.origin[k] + u * at.width[k]))))


def _crossing(values: np.ndarray, rise: np.ndarray) -> float | None:
    """Where the rise passes `SURE` on the way out, by its root, which is straight for a parabola."""
    beyond = np.flatnonzero(rise > SURE)
    if not beyond.size:
        return None
    k = int(beyond[0])
    near, far = np.sqrt(rise[k - 1]), np.sqrt(rise[k])
    return float(values[k - 1] + (values[k] - values[k - 1]) * (np.sqrt(SURE) - near) / (far - near))
