"""Inverse model: the pressure for a force and a length, or the length for a force and a pressure.

The force of the muscle at rest is F(P, L). Newton's method inside a bracket computes its inverses. Their
derivatives follow from the implicit function theorem:

    P(F, L):  ∂P/∂F = 1 / F_P,   ∂P/∂L = −F_L / F_P
    L(F, P):  ∂L/∂F = 1 / F_L,   ∂L/∂P = −F_P / F_L          F_L = ∂F/∂L is the stiffness, F_P = ∂F/∂P

JAX computes the same derivatives, also of higher order and with respect to the muscle's parameters. The
stiffness has the derivatives ∂²F/∂P∂L and ∂²F/∂L². Mechanisms with memory (friction, relaxation), errors of
sensors and compliance of the rig are left out (`neglected.py`). Pressure and length are true values.
The pressure is at the inlet, before the loss by contact of the bladder. The length is without the rig.
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

from pamjax.control.standalone import STATUS_TEXTS
from pamjax.errors import BadInput
from pamjax.infer.fitting.load import LoadedMuscle
from pamjax.jit import compile_on_call
from pamjax.model.balance import Status
from pamjax.model.bench import Bench
from pamjax.model.history import build_time_history
from pamjax.model.mechanism import AbstractPressureLoss, AbstractRigCompliance, Past
from pamjax.model.muscle import Muscle
from pamjax.model.status import StatusCode

#: Maximum number of steps of the root search, and the step size at which it stops, as a share of the range.
#: A step is Newton's, or a bisection if Newton's leaves the bracket.
_MAX_ROOT_STEPS, _ROOT_TOLERANCE = 60, 1e-13

#: Sizes of a batch of commands; other numbers of commands are divided and padded to one of them.
_SMALL_BATCH, _LARGE_BATCH = 16, 4096

#: Ranges of pressure, Pa, and contraction for a muscle without calibrated range.
DEFAULT_PRESSURES, _DEFAULT_CONTRACTIONS = (0.0, 600e3), (0.0, 0.45)

#: Minimum relative width of a calibrated range; a narrower one is a single level.
_MIN_RANGE_WIDTH = 0.01

#: Minimum of ∂F/∂P for a command, as a share of its value at the longest length.
_MIN_PULL_SHARE = 0.02


class CommandLimit(StatusCode):
    """Status of a command; an exported table has the same codes."""

    OK = 0, STATUS_TEXTS[0]
    TOO_STRONG = 1, STATUS_TEXTS[1]
    TOO_WEAK = 2, STATUS_TEXTS[2]
    OUTSIDE = 3, STATUS_TEXTS[3]
    NO_ANSWER = (
        4,
        "no equilibrium: the threads are too soft or straight, or pressure does not increase the force",
    )


class Command(eqx.Module):
    """Commanded values with derivatives; each (n,), SI.

    Attributes:
        value: pressure (Pa) or length (m); the nearest possible one if the status is not OK.
        slope_by_force: its derivative with respect to force.
        slope_by_given: its derivative with respect to the given length or pressure.
        stiffness: ∂F/∂L at the value, N/m.
        status: a `CommandLimit`.
    """

    value: Array
    slope_by_force: Array
    slope_by_given: Array
    stiffness: Array
    status: Array


def compute_static_force(muscle: Muscle | Bench, pressure: Array, length: Array) -> tuple[Array, Array]:
    """Return the force at rest, N, and whether an equilibrium exists, at one pressure (Pa) and length (m)."""
    if isinstance(muscle, Muscle):
        reading = muscle(pressure, length)
        return reading.force, reading.status == int(Status.OK)
    past, status = solve_at_rest(remove_rig(muscle), pressure, length)
    return past.force, status == int(Status.OK)


def remove_rig(bench: Bench) -> Bench:
    """Return the prepared bench without the compliance of its rig."""
    mechanisms = tuple(m for m in bench.mechanisms if not isinstance(m, AbstractRigCompliance))
    return Bench(bench.thread_length, bench.turns, mechanisms).prepare()


def solve_at_rest(bench: Bench, pressure: Array, length: Array) -> tuple[Past, Array]:
    """Return the equilibrium of a prepared bench without memory at one pressure (Pa) and length (m).

    Returns:
        the solved state, with the pressure inside the muscle, and a `balance.Status`.
    """
    zero = jnp.zeros_like(pressure)
    past, status = bench.solve_instant(pressure, length, zero, (zero, zero))
    if not bench.find_mechanisms(AbstractPressureLoss):
        return past, status
    # The pressure inside depends on the state without the line's pressure drop, as in `Bench.compute_past`.
    static_history, one_sample = (
        build_time_history(None, np.ones(1, dtype=bool)),
        jax.tree.map(lambda x: x[None], past),
    )
    for line in bench.find_mechanisms(AbstractPressureLoss):
        one_sample = eqx.tree_at(lambda p: p.pressure, one_sample, line.pressure(static_history, one_sample))
    return bench.solve_instant(one_sample.pressure[0], length, zero, (zero, zero))


def _find_root(function: Callable[[Array], Array], low: Array, high: Array) -> Array:
    """Return the root of an increasing function in a bracket, or the nearer end; derivatives are implicit."""

    def slope(f, x):
        return jax.jvp(f, (x,), (jnp.ones_like(x),))

    def solve(f, start):
        def is_unfinished(carry):
            _, below, above, step_size, count = carry
            return (step_size > _ROOT_TOLERANCE * (high - low)) & (above > below) & (count < _MAX_ROOT_STEPS)

        def step(carry):
            x, below, above, _, count = carry
            value, rise = slope(f, x)
            below, above = jnp.where(value < 0, x, below), jnp.where(value < 0, above, x)
            newton = x - value / jnp.where(rise > 0, rise, jnp.inf)
            inside = (newton >= below) & (newton <= above) & (rise > 0)
            next_x = jnp.where(inside, newton, (below + above) / 2)
            return next_x, below, above, jnp.abs(next_x - x), count + 1

        return jax.lax.while_loop(is_unfinished, step, (start, low, high, high - low, 0))[0]

    def tangent_solve(linear, y):
        rise = linear(jnp.ones_like(y))
        return y / jnp.where(rise != 0, rise, jnp.inf)

    return jax.lax.custom_root(function, (low + high) / 2, solve, tangent_solve)


@dataclass(frozen=True, eq=False)
class Inverse:
    """Inverse model of a muscle within a range.

    Attributes:
        muscle: the muscle, or a `Bench` with mechanisms; its sensors, rig and memory are neglected.
        pressures: lowest and highest pressure, Pa.
        lengths: shortest and longest length, m.
    """

    muscle: Muscle | Bench
    pressures: tuple[float, float]
    lengths: tuple[float, float]

    def force(self, pressure: ArrayLike, length: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Return the force at rest, N, and the stiffness ∂F/∂L, N/m, each (n,)."""
        value, slopes, _ = _map_in_batches(lambda p, l: _compute_forces(self.muscle, p, l), pressure, length)
        return np.asarray(value), np.asarray(slopes[:, 1])

    def pull(self, pressure: ArrayLike, length: ArrayLike) -> np.ndarray:
        """Return ∂F/∂P, N/Pa, (n,)."""
        return np.asarray(
            _map_in_batches(lambda p, l: _compute_forces(self.muscle, p, l), pressure, length)[1][:, 0]
        )

    def stiffness_slopes(self, pressure: ArrayLike, length: ArrayLike) -> np.ndarray:
        """Return the derivatives of the stiffness: ∂²F/∂P∂L, N/(m Pa), and ∂²F/∂L², N/m²; (n, 2)."""
        return np.asarray(
            _map_in_batches(lambda p, l: _compute_stiffness_slopes(self.muscle, p, l), pressure, length)
        )

    def pressure(self, force: ArrayLike, length: ArrayLike) -> Command:
        """Return the pressures for forces (n,), N, at lengths (n,), m."""
        ends = jnp.array(self.pressures), jnp.array(self.lengths)
        return _map_in_batches(lambda f, l: solve_pressures(self.muscle, *ends, f, l), force, length)

    def length(self, force: ArrayLike, pressure: ArrayLike) -> Command:
        """Return the lengths for forces (n,), N, at pressures (n,), Pa."""
        ends = jnp.array(self.pressures), jnp.array(self.lengths)
        return _map_in_batches(lambda f, p: solve_lengths(self.muscle, *ends, f, p), force, pressure)


def _map_in_batches(function: Callable, first: ArrayLike, second: ArrayLike):
    """Return a function's values on two rows, in batches of fixed size; each new size needs a compilation."""
    pair = np.broadcast_arrays(*(np.atleast_1d(np.asarray(x, dtype=float)) for x in (first, second)))
    n = pair[0].size
    size = _SMALL_BATCH if n <= _SMALL_BATCH else _LARGE_BATCH
    parts = max(-(-n // size), 1)
    rows = [np.concatenate([x, np.full(parts * size - n, x[-1] if n else 1.0)]) for x in pair]
    results = [function(*(jnp.asarray(x[k * size : (k + 1) * size]) for x in rows)) for k in range(parts)]
    return jax.tree.map(lambda *x: jnp.concatenate(x)[:n], *results)


@compile_on_call
def _compute_forces(muscle, pressure, length):
    """Return forces, (n,), derivatives by pressure and length, (n, 2), and existence of equilibria, (n,)."""
    return jax.vmap(lambda p, l: _evaluate_force(muscle, p, l))(pressure, length)


@compile_on_call
def _compute_stiffness_slopes(muscle, pressure, length):
    """Return the derivatives of the stiffness by pressure and length, (n, 2)."""
    points = jnp.stack([pressure, length], axis=1)
    return jax.vmap(lambda point: compute_stiffness_slopes(muscle, point))(points)


def compute_stiffness_slopes(muscle: Muscle | Bench, point: Array) -> Array:
    """Return the derivatives of the stiffness by pressure and length, (2,), at a point, (2,)."""

    def stiffness(point):
        return jax.jvp(
            lambda l: compute_static_force(muscle, point[0], l)[0], (point[1],), (jnp.ones_like(point[1]),)
        )[1]

    return jax.jacfwd(stiffness)(point)


def _evaluate_force(muscle, pressure, length):
    """Return force, its derivatives by pressure and length, (2,), and whether an equilibrium exists."""

    def force(p, l):
        return compute_static_force(muscle, p, l)

    def differentiate(by_pressure, by_length):
        return jax.jvp(force, (pressure, length), (by_pressure, by_length), has_aux=True)

    value, slopes, has_equilibrium = jax.vmap(differentiate, out_axes=(None, 0, None))(
        jnp.eye(2)[0], jnp.eye(2)[1]
    )
    return value, slopes, has_equilibrium


@compile_on_call
def solve_pressures(muscle, pressures, lengths, force, length) -> Command:
    """Return the pressures for forces at lengths, each (n,), within the ends (2,) of a range."""
    (low, high), (short, long) = pressures, lengths

    def solve_single(wanted_force, given_length):
        inside = (given_length >= short) & (given_length <= long)
        clipped_length = jnp.clip(given_length, short, long)
        value = _find_root(
            lambda p: compute_static_force(muscle, p, clipped_length)[0] - wanted_force, low, high
        )
        value = jnp.clip(value, low, high)
        # The value, both ends and the longest length in one call, so that the equilibrium is compiled once.
        points = (
            jnp.stack([value, low, high, value]),
            jnp.stack([clipped_length, clipped_length, clipped_length, long]),
        )
        forces, slopes, has_equilibrium = jax.vmap(lambda p, l: _evaluate_force(muscle, p, l))(*points)
        by_p, by_l = slopes[0]
        pulls = has_equilibrium[0] & (by_p > _MIN_PULL_SHARE * slopes[3, 0])
        return Command(
            value,
            1 / by_p,
            -by_l / by_p,
            by_l,
            _classify_status(wanted_force, forces[1], forces[2], inside, pulls),
        )

    return jax.vmap(solve_single)(force, length)


@compile_on_call
def solve_lengths(muscle, pressures, lengths, force, pressure) -> Command:
    """Return the lengths for forces at pressures, each (n,), within the ends (2,) of a range."""
    (low, high), (short, long) = pressures, lengths

    def solve_single(wanted_force, given_pressure):
        inside = (given_pressure >= low) & (given_pressure <= high)
        clipped_pressure = jnp.clip(given_pressure, low, high)
        value = jnp.clip(
            _find_root(
                lambda l: compute_static_force(muscle, clipped_pressure, l)[0] - wanted_force, short, long
            ),
            short,
            long,
        )
        points = (
            jnp.stack([clipped_pressure, clipped_pressure, clipped_pressure]),
            jnp.stack([value, short, long]),
        )
        forces, slopes, has_equilibrium = jax.vmap(lambda p, l: _evaluate_force(muscle, p, l))(*points)
        by_p, by_l = slopes[0]
        status = _classify_status(wanted_force, forces[1], forces[2], inside, has_equilibrium[0] & (by_l > 0))
        return Command(value, 1 / by_l, -by_p / by_l, by_l, status)

    return jax.vmap(solve_single)(force, pressure)


def _classify_status(wanted_force, min_force, max_force, inside, has_equilibrium):
    status = jnp.where(has_equilibrium, int(CommandLimit.OK), int(CommandLimit.NO_ANSWER))
    tolerance = 1e-9 * (jnp.abs(min_force) + jnp.abs(max_force))
    status = jnp.where(wanted_force > max_force + tolerance, int(CommandLimit.TOO_STRONG), status)
    status = jnp.where(wanted_force < min_force - tolerance, int(CommandLimit.TOO_WEAK), status)
    return jnp.where(inside, status, int(CommandLimit.OUTSIDE))


def inverse(
    muscle: Muscle | Bench | LoadedMuscle,
    pressures: tuple[float, float] | None = None,
    lengths: tuple[float, float] | None = None,
) -> Inverse:
    """Return the inverse model of a muscle.

    Args:
        muscle: a muscle, or the result of `load_muscle` for a fit.json, a model.json or a case folder.
        pressures: lowest and highest pressure, Pa. Default: the calibrated range; without one, or with one
            calibrated pressure, 0 to 600 kPa.
        lengths: shortest and longest length, m. Default: the calibrated range; without one, or with one
            calibrated length, 0 to 45 % contraction.

    Returns:
        the `Inverse`; its methods return force, pressure and length, SI.

    Raises:
        BadInput: for an empty range, or for a muscle with mechanisms without `lengths`.

    Example:
        inverse = pamjax.inverse(pamjax.load_muscle("mine"))
        command = inverse.pressure(force=[300.0], length=[0.18])  # N, m
        print(command.value, command.status)  # Pa
    """
    calibrated_range = muscle.calibrated_range if isinstance(muscle, LoadedMuscle) else {}
    calibrated_range = {
        name: (low, high)
        for name, (low, high) in calibrated_range.items()
        if high > low * (1 + _MIN_RANGE_WIDTH)
    }
    bare_muscle = muscle.muscle if isinstance(muscle, LoadedMuscle) else muscle
    if lengths is None and "length" not in calibrated_range:
        if isinstance(muscle, Bench):
            raise BadInput.from_rule(
                "a muscle with mechanisms needs `lengths`",
                "none",
                remedy="State the shortest and the longest length.",
            )
        rest_length = (
            muscle.muscle_toml.rest_length.value
            if isinstance(muscle, LoadedMuscle)
            else float(muscle.rest_length)
        )
        lengths = rest_length * (1 - _DEFAULT_CONTRACTIONS[1]), rest_length * (1 - _DEFAULT_CONTRACTIONS[0])
    ranges = (
        pressures or calibrated_range.get("pressure", DEFAULT_PRESSURES),
        lengths or calibrated_range["length"],
    )
    # Compiled functions receive the range as arrays, so that another range needs no compilation.
    result = Inverse(bare_muscle, *((float(low), float(high)) for low, high in ranges))
    for name, (low, high) in (("pressures", result.pressures), ("lengths", result.lengths)):
        if not low < high:
            raise BadInput.from_rule(
                f"`{name}` must be a lower and a higher limit",
                f"{low:g} to {high:g}",
                remedy="State the lower limit first.",
            )
    return result
