"""The equilibrium of a bench at one instant: thread load, or the gap between a slack bladder and its braid.

With the potential W(L, B) of the bench (`bench.py`)

    load  T = −∂W/∂B,      B = B0 (1 + extension) (1 + Σ strain(T))       threads
    force F = ∂W/∂L,       L = recorded − deflection(F)                   rig

Newton's method solves these two equations for (T, L). The derivative is implicit.

Threads do not push. Where W pulls them inwards, contact is lost: T = 0, and the bladder has the radius at
which its rubber balances the pressure. One unknown x describes both branches: x = T above zero, and the
*slack* s = −x / (SLACK_PRESSURE_SCALE ∂T/∂P) below zero. The slack reduces the radius:

    R² = R0² / √(1 + s),   B² = L² + (2πN R)²        R0 that of the threads without load

The fourth power is used because the hoop pull of a neo-Hookean tube is linear in R⁻⁴. Newton's method
then needs one or two steps from any start. The muscle is not straight at any slack. Loads of memories are
constant during the balance. On a slack muscle they do not reduce the pull on the threads below a lower limit
(`force_and_pull`).
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

#: Maximum number of Newton steps. The first guess of the load is good: two or three steps are usual.
MAX_NEWTON_STEPS = 8

#: Relative Newton step at which the iteration ends. One differentiable step follows. The error before
#: it is of the order of the square of the last step, and after it of the fourth power.
NEWTON_TOLERANCE = 3e-4

#: Pressure, Pa, that scales the unknown of a slack muscle. A bladder resists with 10 to 100 kPa.
SLACK_PRESSURE_SCALE = 1e5

#: Pressure, Pa, that resists each unit of slack. It is small compared with that of a bladder, and makes
#: the balance solvable for a muscle without a bladder.
SLACK_HOLD_PRESSURE = 1.0

#: Residual relative to load and length above which a state is not solved.
BALANCE_TOLERANCE = 1e-6

Pair = tuple[Array, Array]


class BalanceModel(Protocol):
    """Interface of a bench for its balance."""

    turns: Scalar

    def expand_at(self, length: Scalar, thread: Scalar) -> BalanceModel:
        """Return the same bench with its shapes expanded around one length (m) and thread length (m)."""
        ...

    def stop_gradients(self) -> BalanceModel:
        """Return the same bench without derivatives with respect to its parameters."""
        ...

    def state(self, length: Scalar, thread: Scalar) -> State:
        """Return the state at a length (m) and thread length (m)."""
        ...

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
        bench: the muscle with its mechanisms, its shapes expanded around some state.
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
        slack = jnp.where(x < 0, -x, 0.0) / (SLACK_PRESSURE_SCALE * hoop)
        taut = self.unloaded_thread * (1 + self.bench.strain(jnp.where(x < 0, 0.0, x)))
        squared_difference = (self.unloaded_thread - length) * (self.unloaded_thread + length)
        return jnp.where(x < 0, jnp.sqrt(length**2 + squared_difference / jnp.sqrt(1 + slack)), taut)

    def force_and_pull(self, thread: Scalar, length: Scalar) -> Pair:
        """Return tension and pull on all threads, N; a negative pull means that the braid is slack."""
        stored, volume = materialize(
            compute_partial_derivatives(self.bench.energy_and_volume, length, thread)
        )
        force = stored[0] - self.pressure * volume[0] + self.memory_loads[0]
        outward_pull = inflating_pressure(self.pressure) * volume[1] - stored[1]
        lower_limit = jnp.minimum(self.contact_pull, 0.0) - jnp.maximum(outward_pull, 0.0)
        return force, outward_pull + jnp.maximum(self.memory_loads[1], lower_limit)

    def residual(self, unknowns: Pair) -> Pair:
        """Return the residuals of both balances, N and m, at x (N) and a true length (m)."""
        x, length = unknowns
        thread = self.thread_length(x, length)
        force, pull = self.force_and_pull(thread, length)
        load = jnp.where(x < 0, SLACK_HOLD_PRESSURE / SLACK_PRESSURE_SCALE, 1.0) * x
        return load - pull, length + self.bench.deflection(force) - self.length

    def expand_at(self, x: Scalar, length: Scalar) -> InstantBalance:
        """Return the same balance with its shapes expanded around a state."""
        bench = self.bench.expand_at(length, self.thread_length(x, length))
        return eqx.tree_at(lambda instant_balance: instant_balance.bench, self, bench)


def build_instant_balance(
    bench: BalanceModel, pressure: Scalar, length: Scalar, unloaded_thread: Scalar, memory_loads: Pair
) -> InstantBalance:
    """Return the unsolved balance of a bench; see `InstantBalance`."""
    energy_slopes, volume_slopes = compute_partial_derivatives(
        bench.expand_at(length, unloaded_thread).energy_and_volume, length, unloaded_thread
    )
    return InstantBalance(
        bench,
        pressure,
        length,
        unloaded_thread,
        memory_loads,
        inflating_pressure(pressure) * volume_slopes[1] - energy_slopes[1],
    )


def inflating_pressure(pressure: Scalar) -> Array:
    """Return the pressure that pushes the threads outwards, Pa.

    A negative pressure does not push: it is an offset of the gauge, or the tube has collapsed.
    """
    return jnp.where(pressure > 0, pressure, 0.0)


def solve_balance(instant_balance: InstantBalance) -> tuple[InstantBalance, Pair, Array]:
    """Return the balance expanded at its solution, x (N) and true length (m), and whether it is solved."""
    without_gradients = jax.lax.stop_gradient(
        eqx.tree_at(lambda balance: balance.bench, instant_balance, instant_balance.bench.stop_gradients())
    )
    guess = _iterate_newton(
        lambda x: without_gradients.expand_at(*x),
        (without_gradients.contact_pull + without_gradients.memory_loads[1], without_gradients.length),
    )
    expanded_balance = instant_balance.expand_at(*guess)
    solution = materialize(
        jax.lax.custom_root(lambda x: expanded_balance.residual(x), guess, _newton_step, _solve_linear_pair)
    )
    load_error, length_error = expanded_balance.residual(solution)
    is_solved = jnp.abs(load_error) < BALANCE_TOLERANCE * jnp.maximum(jnp.abs(solution[0]), 1.0)
    return (
        expanded_balance,
        solution,
        is_solved & (jnp.abs(length_error) < BALANCE_TOLERANCE * instant_balance.length),
    )


def compute_partial_derivatives(function, a: Scalar, b: Scalar):
    """Return the derivatives of each result by two variables, (2, ...), as one compiled program."""
    unit, zero = jnp.ones_like(a), jnp.zeros_like(a)
    directions = jnp.stack([unit, zero]), jnp.stack([zero, unit])
    return jax.vmap(lambda *t: jax.jvp(function, (a, b), t)[1])(*directions)


def _iterate_newton(balance_at, x: Pair) -> Pair:
    """Return x (N) and true length (m) by Newton's method from the balance expanded at each step."""

    def is_running(carry):
        _, size, count = carry
        return (jnp.max(size) > NEWTON_TOLERANCE) & (count < MAX_NEWTON_STEPS)

    def step(carry):
        x, _, count = carry
        # Shapes are expanded at this step. Threads that stretch by 1 % widen a slender muscle by 10 %, so
        # that an expansion around unloaded threads is not sufficient.
        balance = balance_at(x)
        next_x = _newton_step(lambda x: balance.residual(x), x)
        size = jnp.abs(next_x[0] - x[0]) / jnp.maximum(jnp.abs(x[0]), 1.0), jnp.abs(next_x[1] / x[1] - 1)
        return next_x, jnp.maximum(*size), count + 1

    # Unrolled steps would compile for a minute.
    return jax.lax.while_loop(is_running, step, (x, jnp.ones_like(x[0]), 0))[0]


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
