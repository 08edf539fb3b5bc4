"""The balance of a bench at one instant: how hard the threads pull, or how far the bladder stands off them.

With the potential W(L, B) of the bench (`bench.py`)

    load  T = −∂W/∂B,      B = B0 (1 + extension) (1 + Σ strain(T))       threads
    force F = ∂W/∂L,       L = recorded − deflection(F)                   rig

(T, L) is found by Newton on these two equations; its derivative is implicit.

Threads do not push. Where W pulls them inwards, contact is lost: T = 0, and the bladder stands off the
braid at the radius where its own rubber balances the pressure. One unknown x serves both branches,
x = T above zero and below it the *slack*, s = −x / (SLACK_PRESSURE_SCALE ∂T/∂P), by which the radius has
shrunk:

    R² = R0² / √(1 + s),   B² = L² + (2πN R)²        R0 that of the threads without load

The fourth power, because the hoop pull of a neo-Hookean tube is a straight line in R⁻⁴: Newton then
needs a step or two from wherever it starts, and no slack can make the muscle straight. Frozen stresses
cannot follow the wall: they pull no bladder off the braid that rubber would not, or no more than it does.
"""

from __future__ import annotations

from typing import Protocol

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from pamjax.model import braid
from pamjax.model.barrier import materialize
from pamjax.model.state import State
from pamjax.parameter import Scalar

#: Most Newton steps of the balance. The load is nearly known beforehand: two or three are the rule.
MAX_NEWTON_STEPS = 8

#: Step of Newton, relative, after which only the one that carries the derivatives is taken: what this leaves
#: is of the order of its square, and what that one leaves of its fourth power.
NEWTON_TOLERANCE = 3e-4

#: Pressure, Pa, that scales the unknown of a slack muscle: of the order of what holds a bladder back.
SLACK_PRESSURE_SCALE = 1e5

#: Pressure, Pa, with which a slack muscle is held from shrinking further, for each unit of slack.
#: Next to nothing (a tube of latex is held by tens of kPa), but it leaves no muscle without an answer.
SLACK_HOLD_PRESSURE = 1.0

#: Balance residual, relative to the load and the length, above which a state counts as not solved.
BALANCE_TOLERANCE = 1e-6

Pair = tuple[Array, Array]


class BalanceModel(Protocol):
    """What the balance asks of a bench."""

    turns: Scalar

    def expand_at(self, length: Scalar, thread: Scalar) -> BalanceModel:
        """The same bench, with its shapes as they are needed around one state."""
        ...

    def stop_gradients(self) -> BalanceModel:
        """The same bench, without derivatives by its numbers."""
        ...

    def state(self, length: Scalar, thread: Scalar) -> State:
        """Where everything is."""
        ...

    def energy_and_volume(self, length: Scalar, thread: Scalar) -> Pair:
        """Stored energy without the threads' own, J, and volume, m³."""
        ...

    def strain(self, load: Scalar) -> Array:
        """Strain of the threads at a load, N."""
        ...

    def deflection(self, force: Scalar) -> Array:
        """Give of the rig at a force (N), m."""
        ...


class InstantBalance(eqx.Module):
    """A bench at one instant, or at many: all of it works on arrays of equal shape as well.

    Attributes:
        bench: the muscle with its mechanisms, its shapes as they are around some state.
        pressure, length: recorded, Pa and m.
        unloaded_thread: length of the threads without load, m.
        memory_loads: what memories add to the force and to the pull of the threads, N.
        contact_pull: pull on threads that do not yet stretch, without what is frozen, N.
    """

    bench: BalanceModel
    pressure: Scalar
    length: Scalar
    unloaded_thread: Scalar
    memory_loads: Pair
    contact_pull: Scalar

    def thread_length(self, x: Scalar, length: Scalar) -> Array:
        """Length of the braid's threads, m: stretched, or as if they were taut around a slack bladder."""
        hoop = braid.hoop_pull(1.0, self.length, self.unloaded_thread, self.bench.turns)
        slack = jnp.where(x < 0, -x, 0.0) / (SLACK_PRESSURE_SCALE * hoop)
        taut = self.unloaded_thread * (1 + self.bench.strain(jnp.where(x < 0, 0.0, x)))
        missing = (self.unloaded_thread - length) * (self.unloaded_thread + length)
        return jnp.where(x < 0, jnp.sqrt(length**2 + missing / jnp.sqrt(1 + slack)), taut)

    def force_and_pull(self, thread: Scalar, length: Scalar) -> Pair:
        """Tension, and pull on all threads (negative where the bladder stands off them), N."""
        stored, volume = materialize(
            compute_partial_derivatives(self.bench.energy_and_volume, length, thread)
        )
        force = stored[0] - self.pressure * volume[0] + self.memory_loads[0]
        outward_pull = inflating_pressure(self.pressure) * volume[1] - stored[1]
        least = jnp.minimum(self.contact_pull, 0.0) - jnp.maximum(outward_pull, 0.0)
        return force, outward_pull + jnp.maximum(self.memory_loads[1], least)

    def residual(self, unknown: Pair) -> Pair:
        """What is missing to both balances, N and m, at x (N) and a true length (m)."""
        x, length = unknown
        thread = self.thread_length(x, length)
        force, pull = self.force_and_pull(thread, length)
        load = jnp.where(x < 0, SLACK_HOLD_PRESSURE / SLACK_PRESSURE_SCALE, 1.0) * x
        return load - pull, length + self.bench.deflection(force) - self.length

    def expand_at(self, x: Scalar, length: Scalar) -> InstantBalance:
        """The same, with shapes as they are around a state."""
        bench = self.bench.expand_at(length, self.thread_length(x, length))
        return eqx.tree_at(lambda instant_balance: instant_balance.bench, self, bench)


def build_instant_balance(
    bench: BalanceModel, pressure: Scalar, length: Scalar, unloaded_thread: Scalar, memory_loads: Pair
) -> InstantBalance:
    """A bench before its balance: see `InstantBalance`."""
    stored, volume = compute_partial_derivatives(
        bench.expand_at(length, unloaded_thread).energy_and_volume, length, unloaded_thread
    )
    return InstantBalance(
        bench,
        pressure,
        length,
        unloaded_thread,
        memory_loads,
        inflating_pressure(pressure) * volume[1] - stored[1],
    )


def inflating_pressure(pressure: Scalar) -> Array:
    """The pressure that pushes threads outwards, Pa.

    Suction closes no braid: below zero a gauge is off, or the tube is flat, and no longer round.
    """
    return jnp.where(pressure > 0, pressure, 0.0)


def solve_balance(instant_balance: InstantBalance) -> tuple[InstantBalance, Pair, Array]:
    """x (N) and true length (m) in balance; the bench around them; and whether it was found."""
    without_gradients = jax.lax.stop_gradient(
        eqx.tree_at(lambda balance: balance.bench, instant_balance, instant_balance.bench.stop_gradients())
    )
    guess = _iterate_newton(
        lambda x: without_gradients.expand_at(*x),
        (without_gradients.contact_pull + without_gradients.memory_loads[1], without_gradients.length),
    )
    expanded = instant_balance.expand_at(*guess)
    solution = materialize(
        jax.lax.custom_root(lambda x: expanded.residual(x), guess, _newton_step, _solve_linear_pair)
    )
    off_load, off_length = expanded.residual(solution)
    solved = jnp.abs(off_load) < BALANCE_TOLERANCE * jnp.maximum(jnp.abs(solution[0]), 1.0)
    return expanded, solution, solved & (jnp.abs(off_length) < BALANCE_TOLERANCE * instant_balance.length)


def compute_partial_derivatives(function, a: Scalar, b: Scalar):
    """Derivatives by two numbers, (2, ...) of each result: both at once, so that it is compiled once."""
    unit, zero = jnp.ones_like(a), jnp.zeros_like(a)
    along = jnp.stack([unit, zero]), jnp.stack([zero, unit])
    return jax.vmap(lambda *t: jax.jvp(function, (a, b), t)[1])(*along)


def _iterate_newton(balance_at, x: Pair) -> Pair:
    """x (N) and true length (m), from the instant with its shapes around any of them."""

    def on(carry):
        _, size, count = carry
        return (jnp.max(size) > NEWTON_TOLERANCE) & (count < MAX_NEWTON_STEPS)

    def step(carry):
        x, _, count = carry
        # Threads that stretch by a hundredth widen a slender muscle by a tenth: shapes are as they are here,
        # not as with the threads at rest.
        balance = balance_at(x)
        updated = _newton_step(lambda x: balance.residual(x), x)
        size = jnp.abs(updated[0] - x[0]) / jnp.maximum(jnp.abs(x[0]), 1.0), jnp.abs(updated[1] / x[1] - 1)
        return updated, jnp.maximum(*size), count + 1

    # A loop, not its unrolling, which would compile for a minute.
    return jax.lax.while_loop(on, step, (x, jnp.ones_like(x[0]), 0))[0]


def _newton_step(residual, x: Pair) -> Pair:
    a, b = _solve_two_by_two(
        *materialize((compute_partial_derivatives(lambda *x: residual(x), *x), residual(x)))
    )
    return x[0] - a, x[1] - b


def _solve_linear_pair(linear, y: Pair) -> Pair:
    zero = jnp.zeros_like(y[0])
    return _solve_two_by_two(*materialize((compute_partial_derivatives(lambda *x: linear(x), zero, zero), y)))


def _solve_two_by_two(rows: Pair, y: Pair) -> Pair:
    (a, b), (c, d) = rows
    scale = 1 / (a * d - b * c)
    return (d * y[0] - b * y[1]) * scale, (a * y[1] - c * y[0]) * scale
