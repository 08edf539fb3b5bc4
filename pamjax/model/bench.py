"""The bench: a muscle with everything that models leave out, seen through its sensors.

One potential, as for the bare muscle (`muscle.py`), with every mechanism in its place:

    W(L, B) = Σ stored energies + Σ frozen stress · strain − P V          in a state that geometries wrap

Its balance at one instant is in `instant.py`.

A recording in which something lasts is predicted in two passes. The first, without memory, gives what
memories look at; their stresses are then found all at once (`scan.py`), and with them how hard they pull on
length and thread, which is frozen in the second. The error of that is of the order of the memory's own
effect on what it looks at: some thousandths of the memory.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int

from pamjax.model.balance import Status
from pamjax.model.barrier import written
from pamjax.model.equilibrium import Pair, at_instant, slopes, solve
from pamjax.model.history import History
from pamjax.model.mechanism import (
    AbstractLine,
    AbstractMechanism,
    AbstractMemory,
    AbstractRig,
    AbstractSensor,
    AbstractShape,
    AbstractSlip,
    AbstractStore,
    AbstractYielding,
    Past,
    Samples,
)
from pamjax.model.state import Cylinder, State
from pamjax.parameter import Scalar, parameter

#: What leaves something to later samples, for which a recording is passed twice.
LASTING = (AbstractMemory, AbstractSlip, AbstractLine)

#: Rows whose balance is solved at once.
BLOCK = 256


class Shown(eqx.Module):
    """What a bench shows at every sample.

    Attributes:
        force: recorded tension, N.
        diameter: recorded outer diameter, m.
        past: what the muscle went through, memory included.
        status: (n,) a `balance.Status`.
    """

    force: Samples
    diameter: Samples
    past: Past
    status: Int[Array, " n"]


class Bench(eqx.Module):
    """A muscle with mechanisms, and the bench that records it.

    Without mechanisms it is the ideal inelastic cylinder. Mechanisms of one kind act in their order.
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

    def of(self, kind: type) -> list:
        """The mechanisms of one kind, in order."""
        return [m for m in self.mechanisms if isinstance(m, kind)]

    def __call__(
        self,
        pressure: Samples,
        length: Samples,
        history: History,
        slack: Bool[Array, " n"] | None = None,
    ) -> Shown:
        """What the bench records.

        Args:
            pressure: (n,) recorded gauge pressure, Pa.
            length: (n,) recorded length, m.
            history: time and order of the samples.
            slack: (n,) where the muscle, if it would push, is slack and pulls with nothing; None for nowhere.
        """
        for sensor in self.of(AbstractSensor):
            pressure, length = sensor.undo(pressure, length, history)
        past, status = self.prepared().passed(pressure, length, history)
        force, diameter = past.force, past.state.diameter
        force = force if slack is None else unpushed(force, slack)
        for sensor in self.of(AbstractSensor):
            force, diameter = sensor.read(force, diameter, past, history)
        return Shown(force, diameter, past, status)

    def prepared(self) -> Bench:
        """The same bench, with what all states share worked out once."""
        mechanisms = (
            m.prepared(self.thread_length, self.turns) if isinstance(m, AbstractShape) else m
            for m in self.mechanisms
        )
        return Bench(self.thread_length, self.turns, tuple(mechanisms))

    def passed(self, pressure: Samples, length: Samples, history: History) -> tuple[Past, Array]:
        """What the muscle truly went through at a true pressure (Pa) and length (m), and the status."""
        nothing = jnp.zeros(pressure.shape[0])

        def look(pressure, extension, frozen):
            return _each(self.instant, history.many, pressure, length, extension, frozen)

        without_memory = pressure, nothing, (nothing, nothing)
        if not any(self.of(kind) for kind in LASTING):
            return look(*without_memory)
        passes = 2 if history.lasting is None else jnp.where(history.lasting, 2, 1)

        def once(k, carry):
            given, _ = carry
            past, status = look(*given)
            last = k + 1 == passes
            kept = jax.lax.cond(last, lambda _: given, lambda seen: self._remembered(seen, history), past)
            return kept, (past, status)

        # A loop, so that the balance is compiled once for both passes.
        shape = jax.eval_shape(look, *without_memory)
        unseen = jax.tree.map(lambda x: jnp.zeros(x.shape, x.dtype), shape)
        return jax.lax.fori_loop(0, passes, once, (without_memory, unseen))[1]

    def _remembered(self, first: Past, history: History) -> tuple[Samples, Samples, Pair]:
        """Pressure inside, extension and what memories pull with, from what happened without them."""
        for line in self.of(AbstractLine):
            first = eqx.tree_at(lambda p: p.pressure, first, line.pressure(history, first))
        nothing, memories = jnp.zeros_like(first.pressure), self.of(AbstractMemory)
        seen, begin, many = first, 0, history.many
        if history.settled:
            seen = jax.tree.map(lambda x: jnp.concatenate([x, x]), first)
            history, begin = history.twice(), nothing.size
        extension = sum((slip.extension(history, seen)[begin:] for slip in self.of(AbstractSlip)), nothing)
        strains = [memory.strains(seen.state, seen.pressure).T for memory in memories]
        stresses = [
            m.stresses(history, strain, seen)[begin:] for m, strain in zip(memories, strains, strict=True)
        ]
        frozen = _each(self.frozen, many, first, stresses) if memories else (nothing, nothing)
        return first.pressure, extension, frozen

    def instant(
        self, pressure: Scalar, length: Scalar, extension: Scalar, frozen: Pair
    ) -> tuple[Past, Array]:
        """The balance at one instant, or at many side by side.

        Args:
            pressure, length: Pa and m.
            extension: share by which the threads are longer for good.
            frozen: what memories add to the force and to the pull of the threads, N.
        """
        rest = self.thread_length * (1 + extension)
        here, (x, at), solved = solve(at_instant(self, pressure, length, rest, frozen))
        thread = here.thread(x, at)
        status = jnp.where(solved, int(Status.OK), int(Status.NOT_CONVERGED))
        status = jnp.where(thread > at, status, int(Status.STRAIGHT))
        state = here.bench.state(at, thread)
        past = Past(state, pressure, jnp.where(x < 0, 0.0, x), here.pulls(thread, at)[0])
        return jax.tree.map(lambda value: jnp.broadcast_to(value, jnp.shape(at)), (past, status))

    def near(self, length: Scalar, thread: Scalar) -> Bench:
        """The same bench, with its shapes as they are needed around one state."""
        mechanisms = (m.near(length, thread) if isinstance(m, AbstractShape) else m for m in self.mechanisms)
        return Bench(self.thread_length, self.turns, tuple(mechanisms))

    def held(self) -> Bench:
        """The same bench, without derivatives by its numbers."""
        mechanisms = (
            m.held() if isinstance(m, AbstractShape) else jax.lax.stop_gradient(m) for m in self.mechanisms
        )
        return Bench(*jax.lax.stop_gradient((self.thread_length, self.turns)), tuple(mechanisms))

    def state(self, length: Scalar, thread: Scalar) -> State:
        state = Cylinder()(length, thread, self.turns)
        for shape in self.of(AbstractShape):
            state = shape.shape(state)
        return state

    def works(self, length: Scalar, thread: Scalar) -> Pair:
        """Stored energy without the threads' own, J, and volume, m³."""
        state = self.state(length, thread)
        return sum((store.energy(state) for store in self.of(AbstractStore)), jnp.zeros(())), state.volume

    def frozen(self, past: Past, stresses: list[Float[Array, "... k"]]) -> Pair:
        """What the stresses of all memories, in their order, add to the force and to the threads' pull, N."""
        here = self.near(past.state.length, past.state.thread)

        def work(length, thread):
            state = here.state(length, thread)
            strains = (m.strains(state, past.pressure) for m in self.of(AbstractMemory))
            return sum(
                (jnp.sum(s.T * e, axis=0) for s, e in zip(stresses, strains, strict=True)), jnp.zeros(())
            )

        by_length, by_thread = written(slopes(work, past.state.length, past.state.thread))
        return by_length, -by_thread

    def strain(self, load: Scalar) -> Array:
        """Strain of the threads at a load, N, not negative."""
        return sum((y.strain(load) for y in self.of(AbstractYielding)), jnp.zeros(()))

    def deflection(self, force: Scalar) -> Array:
        return sum((rig.deflection(force) for rig in self.of(AbstractRig)), jnp.zeros(()))


def _each(function, many: Array | None, *rows):
    """The function at every row, in blocks.

    What many rows share while derivatives are taken in many numbers then stays in the cache. And the
    blocks are a loop, whose results are written down: else XLA finds a state anew for every look-up.

    Args:
        function: of rows.
        many: rows that are worked out, the others repeat the last of them; None for all.
        rows: arrays of shape (n, ...).
    """
    n = len(jax.tree.leaves(rows)[0])
    blocks = -(-n // BLOCK)
    if blocks < 2:
        return function(*rows)

    def cut(x):
        filled = jnp.concatenate([x, jnp.broadcast_to(x[-1:], (blocks * BLOCK - n, *x.shape[1:]))])
        return filled.reshape(blocks, BLOCK, *x.shape[1:])

    cuts = jax.tree.map(cut, rows)
    if many is None:
        found = jax.lax.map(jax.checkpoint(lambda block: function(*block)), cuts)
    else:
        found = _first_blocks(function, -(-many // BLOCK), cuts)
    whole = jax.tree.map(lambda x: x.reshape(blocks * BLOCK, *x.shape[2:])[:n], found)
    return whole if many is None else jax.tree.map(lambda x: _last_repeated(x, many), whole)


def _first_blocks(function, count: Array, cuts):
    """The function at the first blocks, of a count that the program need not know; zero at the others."""

    def block(k):
        return function(*jax.tree.map(lambda x: jax.lax.dynamic_index_in_dim(x, k, keepdims=False), cuts))

    def fill(k, found):
        return jax.tree.map(lambda x, y: jax.lax.dynamic_update_index_in_dim(x, y, k, 0), found, block(k))

    blocks = len(jax.tree.leaves(cuts)[0])
    shape = jax.eval_shape(block, 0)
    nothing = jax.tree.map(lambda x: jnp.zeros((blocks, *x.shape), x.dtype), shape)
    return jax.lax.fori_loop(0, count, fill, nothing)


def _last_repeated(values: Array, many: Array) -> Array:
    later = jnp.arange(len(values)).reshape(-1, *[1] * (values.ndim - 1)) >= many
    return jnp.where(later, values[many - 1], values)


def unpushed(force: Samples, slack: Bool[Array, " n"]) -> Samples:
    """Force of a muscle that pulls with nothing where it is slack and the ideal one would push."""
    return jnp.where(slack, jnp.maximum(force, 0.0), force)


@eqx.filter_jit
def record(
    bench: Bench,
    pressure: Samples,
    length: Samples,
    history: History,
    slack: Bool[Array, " n"] | None = None,
) -> Shown:
    """What a bench records, compiled; see `Bench.__call__`."""
    return bench(jnp.asarray(pressure, float), jnp.asarray(length, float), history, slack)
