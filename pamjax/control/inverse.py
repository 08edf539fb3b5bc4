"""What a controller needs: the pressure for a force and a length, the length for a force and a pressure.

The muscle at rest is F(P, L). Its inverses are roots of it, found by Newton's steps inside a bracket, and
their derivatives follow from the implicit function:

    P(F, L):  ∂P/∂F = 1 / F_P,   ∂P/∂L = −F_L / F_P
    L(F, P):  ∂L/∂F = 1 / F_L,   ∂L/∂P = −F_P / F_L          F_L is the stiffness, F_P the pull of a pascal

JAX sees the same derivatives, of any order, in the muscle's own numbers too; the stiffness has its own,
∂²F/∂P∂L and ∂²F/∂L². What the past leaves (friction, relaxation), the errors of sensors and the give of the
rig take no part (`left_out.py`): pressure and length are the true ones, the pressure that before the
bladder's contact, the length the muscle's own.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import ArrayLike

from pamjax.control.standalone import LIMITS
from pamjax.errors import refuse
from pamjax.infer.fitting.load import Loaded
from pamjax.model.balance import Status
from pamjax.model.bench import Bench
from pamjax.model.history import history
from pamjax.model.mechanism import AbstractLine, AbstractRig, Past
from pamjax.model.muscle import Muscle
from pamjax.model.status import Outcome

#: Most Newton steps, or halvings of the bracket where a step would leave it; and the share of the range
#: below which a step is the last.
STEPS, EXACT = 60, 1e-13

#: Wishes that are answered at once: few, or many. All others are cut and padded to these.
FEW, MANY = 16, 4096

#: Where nothing was calibrated: pressures, Pa, and contractions.
PRESSURES, CONTRACTIONS = (0.0, 600e3), (0.0, 0.45)

#: A range narrower than this share of itself is one point, held as well as it was.
NARROW = 0.01

#: Share of the pull of a pascal at the longest length below which pressure commands nothing.
PULLS = 0.02


class Limit(Outcome):
    """What keeps a wish from being met: of a table for a robot the same."""

    OK = 0, LIMITS[0]
    TOO_STRONG = 1, LIMITS[1]
    TOO_WEAK = 2, LIMITS[2]
    OUTSIDE = 3, LIMITS[3]
    NO_ANSWER = 4, "no balance there: threads too soft or straight, or pressure does not pull"


class Command(eqx.Module):
    """What to command, and how it changes; each (n,), SI. Where the status is not OK, the nearest there is.

    Attributes:
        value: pressure (Pa) or length (m).
        by_force: its derivative by force.
        by_other: its derivative by the given length, or pressure.
        stiffness: ∂F/∂L there, N/m.
        status: a `Limit`.
    """

    value: Array
    by_force: Array
    by_other: Array
    stiffness: Array
    status: Array


def static_force(muscle: Muscle | Bench, pressure: Array, length: Array) -> tuple[Array, Array]:
    """Force at rest, N, and whether there is a balance, at one true pressure (Pa) and length (m)."""
    if isinstance(muscle, Muscle):
        reading = muscle(pressure, length)
        return reading.force, reading.status == int(Status.OK)
    past, status = at_rest(off_the_rig(muscle), pressure, length)
    return past.force, status == int(Status.OK)


def off_the_rig(bench: Bench) -> Bench:
    """The same muscle between rigid ends, prepared: a rig's give belongs to the lab."""
    kept = tuple(m for m in bench.mechanisms if not isinstance(m, AbstractRig))
    return Bench(bench.thread_length, bench.turns, kept).prepared()


def at_rest(bench: Bench, pressure: Array, length: Array) -> tuple[Past, Array]:
    """A prepared bench without memory at one true pressure (Pa) and length (m), and its status.

    Returns:
        where everything is, with the pressure that arrives inside, and a `balance.Status`.
    """
    nothing = jnp.zeros_like(pressure)
    past, status = bench.instant(pressure, length, nothing, (nothing, nothing))
    if not bench.of(AbstractLine):
        return past, status
    # What arrives depends on the state without the line, as in `Bench.passed`.
    still, one = history(None, np.ones(1, dtype=bool)), jax.tree.map(lambda x: x[None], past)
    for line in bench.of(AbstractLine):
        one = eqx.tree_at(lambda p: p.pressure, one, line.pressure(still, one))
    return bench.instant(one.pressure[0], length, nothing, (nothing, nothing))


def _root(function: Callable[[Array], Array], low: Array, high: Array) -> Array:
    """Root of a rising function between two ends, or the nearer end; its derivative is the implicit one."""

    def slope(f, x):
        return jax.jvp(f, (x,), (jnp.ones_like(x),))

    def solve(f, start):
        def on(carry):
            _, below, above, moved, count = carry
            return (moved > EXACT * (high - low)) & (above > below) & (count < STEPS)

        def step(carry):
            x, below, above, _, count = carry
            value, rise = slope(f, x)
            below, above = jnp.where(value < 0, x, below), jnp.where(value < 0, above, x)
            newton = x - value / jnp.where(rise > 0, rise, jnp.inf)
            inside = (newton >= below) & (newton <= above) & (rise > 0)
            to = jnp.where(inside, newton, (below + above) / 2)
            return to, below, above, jnp.abs(to - x), count + 1

        return jax.lax.while_loop(on, step, (start, low, high, high - low, 0))[0]

    def tangent_solve(linear, y):
        rise = linear(jnp.ones_like(y))
        return y / jnp.where(rise != 0, rise, jnp.inf)

    return jax.lax.custom_root(function, (low + high) / 2, solve, tangent_solve)


@dataclass(frozen=True, eq=False)
class Inverse:
    """The inverse of a muscle within a range.

    Attributes:
        muscle: the muscle, or a bench whose sensors, rig and memory are left out.
        pressures: lowest and highest, Pa.
        lengths: shortest and longest, m.
    """

    muscle: Muscle | Bench
    pressures: tuple[float, float]
    lengths: tuple[float, float]

    def force(self, pressure: ArrayLike, length: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Force at rest, N, and stiffness ∂F/∂L, N/m, each (n,)."""
        value, slopes, _ = _in_parts(lambda p, l: _forces(self.muscle, p, l), pressure, length)
        return np.asarray(value), np.asarray(slopes[:, 1])

    def pull(self, pressure: ArrayLike, length: ArrayLike) -> np.ndarray:
        """What a pascal more pulls, ∂F/∂P, N/Pa, (n,)."""
        return np.asarray(_in_parts(lambda p, l: _forces(self.muscle, p, l), pressure, length)[1][:, 0])

    def stiffening(self, pressure: ArrayLike, length: ArrayLike) -> np.ndarray:
        """Derivatives of the stiffness by pressure, ∂²F/∂P∂L, N/(m Pa), and length, ∂²F/∂L², N/m²; (n, 2)."""
        return np.asarray(_in_parts(lambda p, l: _stiffenings(self.muscle, p, l), pressure, length))

    def pressure(self, force: ArrayLike, length: ArrayLike) -> Command:
        """The pressure at which the muscle pulls with a force (n,), N, at a length (n,), m."""
        ends = jnp.array(self.pressures), jnp.array(self.lengths)
        return _in_parts(lambda f, l: pressures_of(self.muscle, *ends, f, l), force, length)

    def length(self, force: ArrayLike, pressure: ArrayLike) -> Command:
        """The length at which the muscle pulls with a force (n,), N, at a pressure (n,), Pa."""
        ends = jnp.array(self.pressures), jnp.array(self.lengths)
        return _in_parts(lambda f, p: lengths_of(self.muscle, *ends, f, p), force, pressure)


def _in_parts(function: Callable, one: ArrayLike, other: ArrayLike):
    """A function of two rows, in parts of one size: each size would be compiled anew."""
    pair = np.broadcast_arrays(*(np.atleast_1d(np.asarray(x, dtype=float)) for x in (one, other)))
    n = pair[0].size
    size = FEW if n <= FEW else MANY
    parts = max(-(-n // size), 1)
    rows = [np.concatenate([x, np.full(parts * size - n, x[-1] if n else 1.0)]) for x in pair]
    found = [function(*(jnp.asarray(x[k * size : (k + 1) * size]) for x in rows)) for k in range(parts)]
    return jax.tree.map(lambda *x: jnp.concatenate(x)[:n], *found)


@eqx.filter_jit
def _forces(muscle, pressure, length):
    """Force, its slopes by pressure and by length, and whether there is a balance; each (n,)."""
    return jax.vmap(lambda p, l: _around(muscle, p, l))(pressure, length)


@eqx.filter_jit
def _stiffenings(muscle, pressure, length):
    """Slopes of the stiffness by pressure and length, (n, 2)."""

    def stiffness(at):
        return jax.jvp(lambda l: static_force(muscle, at[0], l)[0], (at[1],), (jnp.ones_like(at[1]),))[1]

    return jax.vmap(jax.jacfwd(stiffness))(jnp.stack([pressure, length], axis=1))


def _around(muscle, pressure, length):
    """Force, its slopes by pressure and length, and whether there is a balance."""

    def force(p, l):
        return static_force(muscle, p, l)

    def along(by_pressure, by_length):
        return jax.jvp(force, (pressure, length), (by_pressure, by_length), has_aux=True)

    value, slopes, there = jax.vmap(along, out_axes=(None, 0, None))(jnp.eye(2)[0], jnp.eye(2)[1])
    return value, slopes, there


@eqx.filter_jit
def pressures_of(muscle, pressures, lengths, force, length) -> Command:
    """Pressures for forces at lengths, each (n,), within the ends (2,) of a range."""
    (low, high), (short, long) = pressures, lengths

    def one(wanted, at):
        inside = (at >= short) & (at <= long)
        at_ = jnp.clip(at, short, long)
        value = _root(lambda p: static_force(muscle, p, at_)[0] - wanted, low, high)
        value = jnp.clip(value, low, high)
        # Together, so that the balance is compiled once: the answer, both ends, and the longest length.
        points = jnp.stack([value, low, high, value]), jnp.stack([at_, at_, at_, long])
        forces, slopes, there = jax.vmap(lambda p, l: _around(muscle, p, l))(*points)
        by_p, by_l = slopes[0]
        pulls = there[0] & (by_p > PULLS * slopes[3, 0])
        return Command(
            value, 1 / by_p, -by_l / by_p, by_l, _status(wanted, forces[1], forces[2], inside, pulls)
        )

    return jax.vmap(one)(force, length)


@eqx.filter_jit
def lengths_of(muscle, pressures, lengths, force, pressure) -> Command:
    """Lengths for forces at pressures, each (n,), within the ends (2,) of a range."""
    (low, high), (short, long) = pressures, lengths

    def one(wanted, at):
        inside = (at >= low) & (at <= high)
        at_ = jnp.clip(at, low, high)
        value = jnp.clip(_root(lambda l: static_force(muscle, at_, l)[0] - wanted, short, long), short, long)
        points = jnp.stack([at_, at_, at_]), jnp.stack([value, short, long])
        forces, slopes, there = jax.vmap(lambda p, l: _around(muscle, p, l))(*points)
        by_p, by_l = slopes[0]
        status = _status(wanted, forces[1], forces[2], inside, there[0] & (by_l > 0))
        return Command(value, 1 / by_l, -by_p / by_l, by_l, status)

    return jax.vmap(one)(force, pressure)


def _status(wanted, least, most, inside, there):
    status = jnp.where(there, int(Limit.OK), int(Limit.NO_ANSWER))
    near = 1e-9 * (jnp.abs(least) + jnp.abs(most))
    status = jnp.where(wanted > most + near, int(Limit.TOO_STRONG), status)
    status = jnp.where(wanted < least - near, int(Limit.TOO_WEAK), status)
    return jnp.where(inside, status, int(Limit.OUTSIDE))


def inverse(
    muscle: Muscle | Bench | Loaded,
    pressures: tuple[float, float] | None = None,
    lengths: tuple[float, float] | None = None,
) -> Inverse:
    """The inverse of a muscle.

    Args:
        muscle: as built, or as `load_muscle` reads it from a fit.json, a model.json or a case folder.
        pressures: lowest and highest, Pa; None for those it was calibrated on; where it was not, or at one
            pressure only, up to 600 kPa.
        lengths: shortest and longest, m; None for those it was calibrated on; where it was not, or at one
            length only, to 45 % contraction.

    Raises:
        BadInput: for an empty range, or a muscle without a rest length where no lengths are given.
    """
    known = muscle.calibrated if isinstance(muscle, Loaded) else {}
    known = {name: (low, high) for name, (low, high) in known.items() if high > low * (1 + NARROW)}
    bare = muscle.muscle if isinstance(muscle, Loaded) else muscle
    if lengths is None and "length" not in known:
        if isinstance(muscle, Bench):
            raise refuse("a bench needs `lengths`", "none", remedy="Give the shortest and the longest.")
        rest = muscle.entry.rest_length.value if isinstance(muscle, Loaded) else float(muscle.rest_length)
        lengths = rest * (1 - CONTRACTIONS[1]), rest * (1 - CONTRACTIONS[0])
    ends = pressures or known.get("pressure", PRESSURES), lengths or known["length"]
    # Arrays, so that another range is no other program.
    found = Inverse(bare, *((float(low), float(high)) for low, high in ends))
    for name, (low, high) in (("pressures", found.pressures), ("lengths", found.lengths)):
        if not low < high:
            raise refuse(f"`{name}` go from low to high", f"{low:g} to {high:g}")
    return found
