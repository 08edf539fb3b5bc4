"""The bench: a muscle with mechanisms, recorded by sensors.

As for the muscle without mechanisms (`muscle.py`) there is one potential:

    W(L, B) = Σ stored energies + Σ memory stress · strain − P V

The geometry is a cylinder, which shape mechanisms modify. `equilibrium.py` solves one instant.

A recording with memory is predicted in two passes. The first pass has no memory. Its result is the input of
the memories, whose stresses are then computed for all rows at once (`scan.py`). The second pass adds their
constant loads on length and thread. The error is some thousandths of the effect of the memory.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from pamjax.jit import compile_on_call
from pamjax.model.balance import Status
from pamjax.model.barrier import materialize
from pamjax.model.equilibrium import (
    NEWTON_TOLERANCE,
    Pair,
    build_instant_balance,
    compute_partial_derivatives,
    solve_balance,
)
from pamjax.model.history import History
from pamjax.model.mechanism import (
    AbstractMechanism,
    AbstractMemory,
    AbstractPressureLoss,
    AbstractRigCompliance,
    AbstractSensor,
    AbstractShape,
    AbstractSlip,
    AbstractStoredEnergy,
    AbstractThreadCompliance,
    Past,
    Samples,
)
from pamjax.model.state import Cylinder, State
from pamjax.parameter import Scalar, parameter

#: Mechanisms whose effect depends on earlier samples. With one of them a recording needs two passes.
HISTORY_DEPENDENT = (AbstractMemory, AbstractSlip, AbstractPressureLoss)

#: Rows whose balance is solved together.
_BLOCK_ROWS = 256


class BenchReading(eqx.Module):
    """Predicted readings of a bench at every sample.

    Attributes:
        force: (n,) recorded tension, N.
        diameter: (n,) recorded outer diameter, m.
        states: true states of the muscle, memory included.
        status: (n,) a `balance.Status`.
    """

    force: Samples
    diameter: Samples
    states: Past
    status: Int[Array, " n"]


class Bench(eqx.Module):
    """A muscle with mechanisms on a test bench.

    Without mechanisms it is the ideal inelastic cylinder. Mechanisms of one kind are applied in order.

    A compiled program for many mechanisms spends most of its time on those that are switched off. With
    `acting`, it computes an expensive mechanism only if it acts. The others must have their neutral values:
    inexpensive ones are always computed.
    """

    thread_length: Scalar = parameter(
        "m", show="mm", low=1e-3, high=20.0, scale="log", about="length B0 of one unloaded thread",
        source="a little longer than the muscle",
    )  # fmt: skip
    turns: Scalar = parameter(
        "1", low=0.05, high=200.0, scale="log", about="turns N of one thread around the muscle",
        source="from B cos(angle) / (pi D)",
    )  # fmt: skip
    mechanisms: tuple[AbstractMechanism, ...] = ()
    #: Whether each mechanism acts, by id. None for all; only None has derivatives in reverse mode.
    acting: dict[str, Bool[Array, ""]] | None = None

    def find_mechanisms(self, kind: type) -> list:
        """Return the mechanisms of one kind, in order."""
        return [m for m in self.mechanisms if isinstance(m, kind)]

    def __call__(
        self,
        pressure: Samples,
        length: Samples,
        history: History,
        slack: Bool[Array, " n"] | None = None,
    ) -> BenchReading:
        """Return the predicted readings.

        Args:
            pressure: (n,) recorded gauge pressure, Pa.
            length: (n,) recorded length, m.
            history: time and order of the samples.
            slack: (n,) whether the muscle can be slack; a negative force is then zero. None for never.
        """
        for sensor in self.find_mechanisms(AbstractSensor):
            pressure, length = sensor.to_true_inputs(pressure, length, history)
        past, status = self.prepare().compute_past(pressure, length, history)
        force, diameter = past.force, past.state.diameter
        force = force if slack is None else clip_slack_force(force, slack)
        for sensor in self.find_mechanisms(AbstractSensor):
            force, diameter = self._compute_if_acting(
                sensor, sensor.to_recorded_outputs, force, diameter, past, history, absent=(force, diameter)
            )
        return BenchReading(force, diameter, past, status)

    def prepare(self) -> Bench:
        """Return the same bench with the quantities that all states share computed."""
        # Only the table of a shape is expensive.
        mechanisms = tuple(
            self._compute_if_acting(m, m.prepare, self.thread_length, self.turns)
            if isinstance(m, AbstractShape)
            else m.prepare(self.thread_length, self.turns)
            for m in self.mechanisms
        )
        return eqx.tree_at(lambda bench: bench.mechanisms, self, mechanisms)

    def compute_past(self, pressure: Samples, length: Samples, history: History) -> tuple[Past, Array]:
        """Return the states at true pressure (Pa) and length (m), both (n,), and their status."""
        zeros = jnp.zeros(pressure.shape[0])

        def solve_all(pressure, extension, memory_loads):
            return _map_blocks(
                self.solve_instant, history.row_count, pressure, length, extension, memory_loads
            )

        without_memory = pressure, zeros, (zeros, zeros)
        with_memory = [m for m in self.mechanisms if isinstance(m, HISTORY_DEPENDENT)]
        if not with_memory:
            return solve_all(*without_memory)
        passes = 2
        if self.acting is not None:
            passes = jnp.where(jnp.stack([self.acting[m.id] for m in with_memory]).any(), 2, 1)

        def run_pass(k, carry):
            inputs, _ = carry
            past, status = solve_all(*inputs)
            is_last = k + 1 == passes
            next_inputs = jax.lax.cond(
                is_last, lambda _: inputs, lambda first_pass: self._compute_memory(first_pass, history), past
            )
            return next_inputs, (past, status)

        # With a loop the balance is compiled once for both passes.
        shape = jax.eval_shape(solve_all, *without_memory)
        empty_result = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shape)
        return jax.lax.fori_loop(0, passes, run_pass, (without_memory, empty_result))[1]

    def _compute_memory(self, first_pass: Past, history: History) -> tuple[Samples, Samples, Pair]:
        """Return inner pressure (Pa), thread extension and memory loads (N), from the pass without memory."""
        for line in self.find_mechanisms(AbstractPressureLoss):
            inner_pressure = self._compute_if_acting(
                line, line.pressure, history, first_pass, absent=first_pass.pressure
            )
            first_pass = eqx.tree_at(lambda p: p.pressure, first_pass, inner_pressure)
        zeros, memories = jnp.zeros_like(first_pass.pressure), self.find_mechanisms(AbstractMemory)
        repeated_past, first_row, row_count = first_pass, 0, history.row_count
        if history.settled:
            repeated_past = jax.tree.map(lambda x: jnp.concatenate([x, x]), first_pass)
            history, first_row = history.repeat(), zeros.size
        extension = sum(
            (
                self._compute_if_acting(slip, slip.extension, history, repeated_past)[first_row:]
                for slip in self.find_mechanisms(AbstractSlip)
            ),
            zeros,
        )

        def compute_stresses(memory: AbstractMemory, past: Past) -> Array:
            return memory.stresses(history, memory.strains(past.state, past.pressure).T, past)[first_row:]

        stresses = [
            self._compute_if_acting(memory, compute_stresses, memory, repeated_past) for memory in memories
        ]
        memory_loads = (
            _map_blocks(self.compute_memory_loads, row_count, first_pass, stresses)
            if memories
            else (zeros, zeros)
        )
        return first_pass.pressure, extension, memory_loads

    def _compute_if_acting(self, mechanism: AbstractMechanism, function, *arguments, absent=None):
        """Return the function's value if a mechanism acts, else `absent`, or zeros if omitted.

        Args:
            mechanism: the mechanism.
            function: a function of the arguments.
            arguments: pytrees of arrays.
            absent: the value without the mechanism.
        """
        if self.acting is None:
            return function(*arguments)
        if absent is None:
            shape = jax.eval_shape(function, *arguments)
            absent = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shape)
        return jax.lax.cond(self.acting[mechanism.id], lambda: function(*arguments), lambda: absent)

    def solve_instant(
        self, pressure: Scalar, length: Scalar, extension: Scalar, memory_loads: Pair
    ) -> tuple[Past, Array]:
        """Return state and status at one instant, or at many.

        Args:
            pressure: gauge pressure, Pa.
            length: recorded length, m.
            extension: permanent relative increase of thread length.
            memory_loads: force and pull on the threads by memories, N.
        """
        unloaded_thread = self.thread_length * (1 + extension)
        balance = build_instant_balance(self, pressure, length, unloaded_thread, memory_loads)
        x, true_length, force, last_step = materialize(solve_balance(balance))
        thread = balance.thread_length(x, true_length)
        is_solved = last_step < NEWTON_TOLERANCE
        status = jnp.where(is_solved, int(Status.OK), int(Status.NOT_CONVERGED))
        status = jnp.where(thread > true_length, status, int(Status.STRAIGHT))
        past = Past(self.state(true_length, thread), pressure, jnp.where(x < 0, 0.0, x), force)
        return jax.tree.map(lambda value: jnp.broadcast_to(value, jnp.shape(true_length)), (past, status))

    def state(self, length: Scalar, thread: Scalar) -> State:
        """Return the state at a length (m) and thread length (m)."""
        state = Cylinder()(length, thread, self.turns)
        for shape in self.find_mechanisms(AbstractShape):
            state = materialize(self._compute_if_acting(shape, shape.shape, state, absent=state))
        return state

    def energy_and_volume(self, length: Scalar, thread: Scalar) -> Pair:
        """Return stored energy without that of the threads (J), and volume (m³)."""
        state = self.state(length, thread)
        return sum(
            (
                materialize(self._compute_if_acting(store, store.energy, state))
                for store in self.find_mechanisms(AbstractStoredEnergy)
            ),
            jnp.zeros(()),
        ), state.volume

    def compute_memory_loads(self, past: Past, stresses: list[Float[Array, "... k"]]) -> Pair:
        """Return force and pull on the threads, N, by the stresses of all memories in their order."""

        def work(length, thread):
            state = self.state(length, thread)
            memories = self.find_mechanisms(AbstractMemory)
            return sum(
                (
                    self._compute_if_acting(memory, compute_work, memory, stress, state)
                    for memory, stress in zip(memories, stresses, strict=True)
                ),
                jnp.zeros(()),
            )

        def compute_work(memory: AbstractMemory, stress: Array, state: State) -> Array:
            return jnp.sum(stress.T * memory.strains(state, past.pressure), axis=0)

        _, (by_length, by_thread) = materialize(
            compute_partial_derivatives(work, past.state.length, past.state.thread)
        )
        return by_length, -by_thread

    def strain(self, load: Scalar) -> Array:
        """Return the strain of the threads at a load, N, that is not negative."""
        return sum((y.strain(load) for y in self.find_mechanisms(AbstractThreadCompliance)), jnp.zeros(()))

    def deflection(self, force: Scalar) -> Array:
        """Return the deflection of the rig, m, at a force, N."""
        return sum(
            (rig.deflection(force) for rig in self.find_mechanisms(AbstractRigCompliance)), jnp.zeros(())
        )


def _map_blocks(function, row_count: Array | None, *rows):
    """Return a function's values at all rows, computed in blocks.

    The intermediate results of one block stay in the cache while derivatives are computed. The blocks are a
    loop, so that XLA does not compute a state again for each of its users.

    Args:
        function: of rows.
        row_count: number of rows to compute; the others repeat the last one. None for all.
        rows: arrays of shape (n, ...).
    """
    n = len(jax.tree.leaves(rows)[0])
    blocks = -(-n // _BLOCK_ROWS)
    if blocks < 2:
        return function(*rows)

    def split(x):
        filled_rows = jnp.concatenate([x, jnp.broadcast_to(x[-1:], (blocks * _BLOCK_ROWS - n, *x.shape[1:]))])
        return filled_rows.reshape(blocks, _BLOCK_ROWS, *x.shape[1:])

    split_rows = jax.tree.map(split, rows)
    if row_count is None:
        results = jax.lax.map(jax.checkpoint(lambda block: function(*block)), split_rows)
    else:
        results = _map_first_blocks(function, -(-row_count // _BLOCK_ROWS), split_rows)
    joined_rows = jax.tree.map(lambda x: x.reshape(blocks * _BLOCK_ROWS, *x.shape[2:])[:n], results)
    return (
        joined_rows if row_count is None else jax.tree.map(lambda x: _repeat_last(x, row_count), joined_rows)
    )


def _map_first_blocks(function, count: Array, split_rows):
    """Return the function at the first blocks, zero at the others; the count may be traced."""

    def block(k):
        return function(
            *jax.tree.map(lambda x: jax.lax.dynamic_index_in_dim(x, k, keepdims=False), split_rows)
        )

    def fill(k, results):
        return jax.tree.map(lambda x, y: jax.lax.dynamic_update_index_in_dim(x, y, k, 0), results, block(k))

    blocks = len(jax.tree.leaves(split_rows)[0])
    shape = jax.eval_shape(block, 0)
    zeros = jax.tree.map(lambda x: jnp.zeros((blocks, *x.shape), x.dtype), shape)
    return jax.lax.fori_loop(0, count, fill, zeros)


def _repeat_last(values: Array, row_count: Array) -> Array:
    is_repeated = jnp.arange(len(values)).reshape(-1, *[1] * (values.ndim - 1)) >= row_count
    return jnp.where(is_repeated, values[row_count - 1], values)


def remove_memories(bench: Bench) -> Bench:
    """Return the bench without the mechanisms whose effect depends on earlier samples."""
    static = tuple(m for m in bench.mechanisms if not isinstance(m, HISTORY_DEPENDENT))
    return eqx.tree_at(lambda bench: bench.mechanisms, bench, static)


def clip_slack_force(force: Samples, slack: Bool[Array, " n"]) -> Samples:
    """Return the force with zero in place of negative values where the muscle can be slack."""
    return jnp.where(slack, jnp.maximum(force, 0.0), force)


@compile_on_call
def record_bench(
    bench: Bench,
    pressure: Samples,
    length: Samples,
    history: History,
    slack: Bool[Array, " n"] | None = None,
) -> BenchReading:
    """Return the predicted readings of a bench by a compiled program; see `Bench.__call__`."""
    return bench(jnp.asarray(pressure, float), jnp.asarray(length, float), history, slack)
