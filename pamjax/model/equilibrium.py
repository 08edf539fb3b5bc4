"""The equilibrium of a bench at one instant: thread load, or the gap between a slack bladder and its braid.

With the potential W(L, B) of the bench (`bench.py`)

    load  T = −∂W/∂B,      B = B0 (1 + extension) (1 + Σ strain(T))       threads
    force F = ∂W/∂L,       L = recorded − deflection(F)                   rig

Newton's method solves these two equations for (T, L). The derivative is implicit.

Threads do not push. Where W pulls them inwards, contact is lost: T = 0, and the bladder has the radius at
which its rubber balances the pressure. One unknown x describes both branches: x = T above zero, and the
*slack* s = −x / (_SLACK_PRESSURE_SCALE ∂T/∂P) below zero. The slack reduces the radius:

    R² = R0² / √(1 + s),   B² = L² + (2πN R)²        R0 that of the threads without load

The fourth power is used because the hoop pull of a neo-Hookean tube is linear in R⁻⁴. Newton's method
then needs one or two steps from any start. The muscle is not straight at any slack. Loads of memories are
constant during the balance. On a slack muscle they do not reduce the pull on the threads below a lower limit
(`force_and_pull`).
"""

from __future__ import annotations

from typing import NamedTuple, Protocol

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from pamjax.model import braid
from pamjax.model.barrier import materialize
from pamjax.parameter import Scalar

#: Maximum number of Newton steps. The first guess of the load is good: two or three steps are usual.
_MAX_NEWTON_STEPS = 8

#: Relative Newton step after which one more step ends the iteration. The error before this step is of the
#: order of the square of the last one, and after it of the fourth power.
NEWTON_TOLERANCE = 3e-4

#: Pressure, Pa, that scales the unknown of a slack muscle. A bladder resists with 10 to 100 kPa.
_SLACK_PRESSURE_SCALE = 1e5

#: Pressure, Pa, that resists each unit of slack. It is small compared with that of a bladder, and makes
#: the balance solvable for a muscle without a bladder.
_SLACK_HOLD_PRESSURE = 1.0

Pair = tuple[Array, Array]


class BalanceModel(Protocol):
    """Interface of a bench for its balance."""

    turns: Scalar

    def energy_and_volume(self, length: Scalar, thread: Scalar) -> Pair:
        """Return stored energy without that of the threads (J), and volume (m³)."""
        ...

    def strain(self, load: Scalar) -> Array:
        """Return the strain of the threads at a load, N."""
        ...

    def deflection(self, force: Scalar) -> Array:
        """Return the deflection of the rig, m, at a force, N."""
        ...


class InstantBalance(eqx.Module):
    """A bench at one instant, or at many as arrays of one shape.

    Attributes:
        bench: the muscle with its mechanisms.
        pressure: gauge pressure, Pa.
        length: recorded length, m.
        unloaded_thread: length of the threads without load, m.
        memory_loads: force and pull on the threads by memories, N.
        contact_pull: pull on unstretched threads without memory loads, N.
    """

    bench: BalanceModel
    pressure: Scalar
    length: Scalar
    unloaded_thread: Scalar
    memory_loads: Pair
    contact_pull: Scalar

    def thread_length(self, x: Scalar, length: Scalar) -> Array:
        """Return the length of the threads, m: stretched, or that of taut threads around a slack bladder."""
        hoop = braid.hoop_pull(1.0, self.length, self.unloaded_thread, self.bench.turns)
        slack = jnp.where(x < 0, -x, 0.0) / (_SLACK_PRESSURE_SCALE * hoop)
        taut = self.unloaded_thread * (1 + self.bench.strain(jnp.where(x < 0, 0.0, x)))
        squared_difference = (self.unloaded_thread - length) * (self.unloaded_thread + length)
        return jnp.where(x < 0, jnp.sqrt(length**2 + squared_difference / jnp.sqrt(1 + slack)), taut)

    def force_and_pull(self, thread: Scalar, length: Scalar) -> Pair:
        """Return tension and pull on all threads, N; a negative pull means that the braid is slack."""
        _, (stored, volume) = _differentiate_energy(self.bench, length, thread)
        force = stored[0] - self.pressure * volume[0] + self.memory_loads[0]
        outward_pull = _inflating_pressure(self.pressure) * volume[1] - stored[1]
        lower_limit = jnp.minimum(self.contact_pull, 0.0) - jnp.maximum(outward_pull, 0.0)
        return force, outward_pull + jnp.maximum(self.memory_loads[1], lower_limit)

    def compute_errors(self, x: Scalar, length: Scalar) -> tuple[Array, Array, Array]:
        """Return the errors of both balances, N and m, and the tension, N, at x (N) and a true length (m)."""
        force, pull = self.force_and_pull(self.thread_length(x, length), length)
        load = jnp.where(x < 0, _SLACK_HOLD_PRESSURE / _SLACK_PRESSURE_SCALE, 1.0) * x
        return load - pull, length + self.bench.deflection(force) - self.length, force


@jax.jit
def _differentiate_energy(
    bench: BalanceModel, length: Scalar, thread: Scalar
) -> tuple[Pair, tuple[Pair, Pair]]:
    """Return energy and volume with their derivatives; `jax.jit` only saves the time to trace it again."""
    return compute_partial_derivatives(bench.energy_and_volume, length, thread)


class Equilibrium(NamedTuple):
    """The solution of a balance.

    Attributes:
        x: load of the threads, N, or slack below zero.
        length: true length, m.
        force: tension, N.
        last_step: relative size of the last Newton step; its square is about the error.
    """

    x: Array
    length: Array
    force: Array
    last_step: Array


def build_instant_balance(
    bench: BalanceModel, pressure: Scalar, length: Scalar, unloaded_thread: Scalar, memory_loads: Pair
) -> InstantBalance:
    """Return the unsolved balance of a bench; see `InstantBalance`."""
    _, (energy_slopes, volume_slopes) = _differentiate_energy(bench, length, unloaded_thread)
    return InstantBalance(
        bench,
        pressure,
        length,
        unloaded_thread,
        memory_loads,
        _inflating_pressure(pressure) * volume_slopes[1] - energy_slopes[1],
    )


def _inflating_pressure(pressure: Scalar) -> Array:
    """Return the pressure that pushes the threads outwards, Pa.

    A negative pressure does not push: it is an offset of the gauge, or the tube has collapsed.
    """
    return jnp.where(pressure > 0, pressure, 0.0)


@jax.custom_jvp
def solve_balance(balance: InstantBalance) -> Equilibrium:
    """Return the solution of a balance, with the derivative of the implicit function."""

    def is_running(carry):
        # The step after the first small one is also done: its error is of the fourth power.
        _, previous_step, count = carry
        return (jnp.max(previous_step) > NEWTON_TOLERANCE) & (count < _MAX_NEWTON_STEPS)

    def iterate(carry):
        solution, _, count = carry
        return _step_newton(balance, solution), solution.last_step, count + 1

    unit = jnp.ones_like(balance.contact_pull)
    x = balance.contact_pull + balance.memory_loads[1]
    start = Equilibrium(x, balance.length * unit, 0 * x, unit)
    # Unrolled steps would compile for a minute.
    return jax.lax.while_loop(is_running, iterate, (start, unit, 0))[0]


@solve_balance.defjvp
def _differentiate_equilibrium(primals, tangents) -> tuple[Equilibrium, Equilibrium]:
    (balance,), (step,) = primals, tangents
    solution = solve_balance(balance)
    unknowns = solution.x, solution.length
    _, slopes = compute_partial_derivatives(balance.compute_errors, *unknowns)
    changes = jax.jvp(lambda balance: balance.compute_errors(*unknowns), (balance,), (step,))[1]
    slopes, changes = materialize((slopes, changes))
    dx, dlength, dforce = _solve_linear(slopes, changes)
    return solution, Equilibrium(dx, dlength, dforce, jnp.zeros_like(solution.last_step))


def _step_newton(balance: InstantBalance, before: Equilibrium) -> Equilibrium:
    values, slopes = materialize(compute_partial_derivatives(balance.compute_errors, before.x, before.length))
    dx, dlength, dforce = _solve_linear(slopes, (*values[:2], jnp.zeros_like(values[2])))
    x, length = before.x + dx, before.length + dlength
    last_step = jnp.maximum(
        jnp.abs(dx) / jnp.maximum(jnp.abs(before.x), 1.0), jnp.abs(dlength / before.length)
    )
    return Equilibrium(x, length, values[2] + dforce, last_step)


def compute_partial_derivatives(function, a: Scalar, b: Scalar):
    """Return the results of a function, and the derivatives of each by its two variables, (2, ...)."""
    unit, zero = jnp.ones_like(a), jnp.zeros_like(a)
    directions = jnp.stack([unit, zero]), jnp.stack([zero, unit])
    return jax.vmap(lambda *t: jax.jvp(function, (a, b), t), out_axes=(None, 0))(*directions)


def _solve_linear(slopes: tuple[Array, ...], changes: tuple[Array, ...]) -> tuple[Array, Array, Array]:
    """Return the steps of x and length that cancel changes of both errors, and the change of the force.

    Args:
        slopes: derivatives of both errors and of the force by x and length, (2, ...) each.
        changes: changes of both errors and of the force at constant x and length.
    """
    (a, b), (c, d), (force_by_x, force_by_length) = slopes
    scale = -1 / (a * d - b * c)
    dx = (d * changes[0] - b * changes[1]) * scale
    dlength = (a * changes[1] - c * changes[0]) * scale
    return dx, dlength, changes[2] + force_by_x * dx + force_by_length * dlength
