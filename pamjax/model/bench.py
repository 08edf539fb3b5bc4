"""The bench: a muscle with everything that models leave out, seen through its sensors.

One potential, as for the bare muscle (`muscle.py`), with every mechanism in its place:

    W(L, B) = Σ stored energies + Σ frozen stress · strain − P V          in a state that geometries wrap
    load  T = −∂W/∂B,      B = B0 (1 + extension) (1 + Σ strain(T))       threads
    force F = ∂W/∂L,       L = recorded − deflection(F)                   rig

(T, L) is found by Newton on these two equations; its derivative is implicit.

Threads do not push. Where W pulls them inwards, contact is lost: T = 0, and the bladder stands off the
braid at the radius where its own rubber balances the pressure. One unknown x serves both branches,
x = T above zero and below it the *slack*, s = −x / (NATURAL ∂T/∂P), by which the radius has shrunk:

    R² = R0² / √(1 + s),   B² = L² + (2πN R)²        R0 that of the threads without load

The fourth power, because the hoop pull of a neo-Hookean tube is a straight line in R⁻⁴: Newton then
needs a step or two from wherever it starts, and no slack can make the muscle straight. Frozen stresses
cannot follow the wall: they pull no bladder off the braid that rubber would not, or no more than it does.

A recording is predicted in two passes. The first, without memory, gives what memories look at; their
stresses are then found all at once (`scan.py`), and with them how hard they pull on length and thread,
which is frozen in the second. The error of that is of the order of the memory's own effect on what it
looks at: some thousandths of the memory.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from pamjax.model import braid
from pamjax.model.balance import Status
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

#: Most Newton steps of the balance. The load is nearly known beforehand: two or three are the rule.
STEPS = 8

#: Step of Newton, relative, after which none is taken: what is left is of the order of its square.
ENOUGH = 1e-8

#: Rows whose balance is solved at once.
BLOCK = 256

#: Pressure, Pa, that scales the unknown of a slack muscle: of the order of what holds a bladder back.
NATURAL = 1e5

#: Pressure, Pa, with which a slack muscle is held from shrinking further, for each unit of slack.
#: Next to nothing (a tube of latex is held by tens of kPa), but it leaves no muscle without an answer.
HOLD = 1.0

#: Balance residual, relative to the load and the length, above which a state counts as not solved.
TOLERANCE = 1e-6


Pair = tuple[Array, Array]


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

    def __call__(self, pressure: Samples, length: Samples, history: History) -> Shown:
        """What the bench records.

        Args:
            pressure: (n,) recorded gauge pressure, Pa.
            length: (n,) recorded length, m.
            history: time and order of the samples.
        """
        for sensor in self.of(AbstractSensor):
            pressure, length = sensor.undo(pressure, length, history)
        past, status = self.prepared().passed(pressure, length, history)
        force, diameter = past.force, past.state.diameter
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
            return _each(self.instant, pressure, length, extension, frozen)

        without_memory = pressure, nothing, (nothing, nothing)
        if not any(self.of(kind) for kind in (AbstractMemory, AbstractSlip, AbstractLine)):
            return look(*without_memory)

        def passes(given, last):
            past, status = look(*given)
            kept = jax.lax.cond(last, lambda _: given, lambda seen: self._remembered(seen, history), past)
            return kept, (past, status)

        # A loop, so that the balance is compiled once for both passes.
        _, both = jax.lax.scan(passes, without_memory, jnp.array([False, True]))
        return jax.tree.map(lambda of_passes: of_passes[-1], both)

    def _remembered(self, first: Past, history: History) -> tuple[Samples, Samples, Pair]:
        """Pressure inside, extension and what memories pull with, from what happened without them."""
        for line in self.of(AbstractLine):
            first = eqx.tree_at(lambda p: p.pressure, first, line.pressure(history, first))
        nothing, memories = jnp.zeros_like(first.pressure), self.of(AbstractMemory)
        seen, begin = first, 0
        if history.settled:
            seen = jax.tree.map(lambda x: jnp.concatenate([x, x]), first)
            history, begin = history.twice(), nothing.size
        extension = sum((slip.extension(history, seen)[begin:] for slip in self.of(AbstractSlip)), nothing)
        strains = [jax.vmap(memory.strains)(seen.state, seen.pressure) for memory in memories]
        stresses = [
            m.stresses(history, strain, seen)[begin:] for m, strain in zip(memories, strains, strict=True)
        ]
        frozen = _each(self._frozen, first, stresses) if memories else (nothing, nothing)
        return first.pressure, extension, frozen

    def instant(
        self, pressure: Scalar, length: Scalar, extension: Scalar, frozen: Pair
    ) -> tuple[Past, Array]:
        """The balance at one instant.

        Args:
            pressure, length: Pa and m.
            extension: share by which the threads are longer for good.
            frozen: what memories add to the force and to the pull of the threads, N.
        """
        rest = self.thread_length * (1 + extension)
        begin = self._near(length, rest)
        hoop = braid.hoop_pull(1.0, length, rest, self.turns)
        # Suction closes no braid: below zero a gauge is off, or the tube is flat, and no longer round.
        inflating = jnp.where(pressure > 0, pressure, 0.0)

        def thread(x, at):
            slack = jnp.where(x < 0, -x, 0.0) / (NATURAL * hoop)
            taut = rest * (1 + self._strain(jnp.where(x < 0, 0.0, x)))
            stands_off = jnp.sqrt(at**2 + (rest - at) * (rest + at) / jnp.sqrt(1 + slack))
            return jnp.where(x < 0, stands_off, taut)

        def load(x):
            return jnp.where(x < 0, HOLD / NATURAL, 1.0) * x

        def free(bench, thread, at):
            stored, volume = _slope(lambda b: bench._works(at, b), thread)
            return inflating * volume - stored

        at_contact = free(begin, rest, length)
        # Threads that stretch by a hundredth widen a slender muscle by a tenth: what holds near a state must
        # be that of the state which the balance will find, not of the threads at rest.
        here = self._near(length, jax.lax.stop_gradient(thread(at_contact + frozen[1], length)))

        def pull(thread, at):
            of_all = free(here, thread, at)
            return of_all + jnp.maximum(frozen[1], jnp.minimum(at_contact, 0.0) - jnp.maximum(of_all, 0.0))

        def force(thread, at):
            stored, volume = _slope(lambda a: here._works(a, thread), at)
            return stored - pressure * volume + frozen[0]

        def residual(unknown):
            x, at = unknown
            stretched = thread(x, at)
            return load(x) - pull(stretched, at), at + self._deflection(force(stretched, at)) - length

        start = at_contact + frozen[1], length
        x, at = jax.lax.custom_root(residual, start, _newton, _solve_two)
        off_load, off_length = residual((x, at))
        solved = jnp.abs(off_load) < TOLERANCE * jnp.maximum(jnp.abs(x), 1.0)
        solved &= jnp.abs(off_length) < TOLERANCE * length
        stretched = thread(x, at)
        state = here._state(at, stretched)
        status = jnp.where(solved, int(Status.OK), int(Status.NOT_CONVERGED))
        status = jnp.where(state.thread > state.length, status, int(Status.STRAIGHT))
        return Past(state, pressure, jnp.where(x < 0, 0.0, x), force(stretched, at)), status

    def _near(self, length: Scalar, thread: Scalar) -> Bench:
        """The same bench, with its shapes as they are needed around one state."""
        mechanisms = (m.near(length, thread) if isinstance(m, AbstractShape) else m for m in self.mechanisms)
        return Bench(self.thread_length, self.turns, tuple(mechanisms))

    def _state(self, length: Scalar, thread: Scalar) -> State:
        state = Cylinder()(length, thread, self.turns)
        for shape in self.of(AbstractShape):
            state = shape.shape(state)
        return state

    def _works(self, length: Scalar, thread: Scalar) -> Pair:
        """Stored energy without the threads' own, J, and volume, m³."""
        state = self._state(length, thread)
        return sum((store.energy(state) for store in self.of(AbstractStore)), jnp.zeros(())), state.volume

    def _frozen(self, past: Past, stresses: list[Float[Array, " k"]]) -> Pair:
        """What frozen stresses add to the force, and to the pull of the threads, N."""

        here = self._near(past.state.length, past.state.thread)

        def work(length, thread):
            state = here._state(length, thread)
            strains = (m.strains(state, past.pressure) for m in self.of(AbstractMemory))
            return sum((jnp.sum(s * e) for s, e in zip(stresses, strains, strict=True)), jnp.zeros(()))

        by_length, by_thread = jax.grad(work, argnums=(0, 1))(past.state.length, past.state.thread)
        return by_length, -by_thread

    def _strain(self, load: Scalar) -> Array:
        """Strain of the threads at a load, N, not negative."""
        return sum((y.strain(load) for y in self.of(AbstractYielding)), jnp.zeros(()))

    def _deflection(self, force: Scalar) -> Array:
        return sum((rig.deflection(force) for rig in self.of(AbstractRig)), jnp.zeros(()))


def _each(function, *rows):
    """The function at every row, in blocks.

    What many rows share while derivatives are taken in many numbers then stays in the cache. And the
    blocks are a loop, whose results are written down: else XLA finds a state anew for every look-up.
    """
    n = len(jax.tree.leaves(rows)[0])
    blocks = -(-n // BLOCK)
    if blocks < 2:
        return jax.vmap(function)(*rows)

    def cut(x):
        filled = jnp.concatenate([x, jnp.broadcast_to(x[-1:], (blocks * BLOCK - n, *x.shape[1:]))])
        return filled.reshape(blocks, BLOCK, *x.shape[1:])

    found = jax.lax.map(jax.checkpoint(lambda block: jax.vmap(function)(*block)), jax.tree.map(cut, rows))
    return jax.tree.map(lambda x: x.reshape(blocks * BLOCK, *x.shape[2:])[:n], found)


def _slope(function, at: Scalar):
    """Derivative by one number. Forward, and one number at a time, so that what is constant costs nothing."""
    return jax.jvp(function, (at,), (jnp.ones_like(at),))[1]


def _columns(function, x: Pair) -> tuple[Pair, Pair]:
    return _slope(lambda a: function((a, x[1])), x[0]), _slope(lambda b: function((x[0], b)), x[1])


def _newton(residual, x: Pair) -> Pair:
    def on(carry):
        _, size, count = carry
        return (jnp.max(size) > ENOUGH) & (count < STEPS)

    def step(carry):
        x, _, count = carry
        a, b = _two_by_two(_columns(residual, x), residual(x))
        size = jnp.stack([jnp.abs(a) / jnp.maximum(jnp.abs(x[0]), 1.0), jnp.abs(b / x[1])])
        return (x[0] - a, x[1] - b), size, count + 1

    # A loop, not its unrolling, which would compile for a minute.
    return jax.lax.while_loop(on, step, (x, jnp.ones(2), 0))[0]


def _solve_two(linear, y: Pair) -> Pair:
    return _two_by_two(_columns(linear, (jnp.zeros_like(y[0]), jnp.zeros_like(y[1]))), y)


def _two_by_two(columns: tuple[Pair, Pair], y: Pair) -> Pair:
    (a, c), (b, d) = columns
    scale = 1 / (a * d - b * c)
    return (d * y[0] - b * y[1]) * scale, (a * y[1] - c * y[0]) * scale


@eqx.filter_jit
def record(bench: Bench, pressure: Samples, length: Samples, history: History) -> Shown:
    """What a bench records, compiled; see `Bench.__call__`."""
    return bench(jnp.asarray(pressure, float), jnp.asarray(length, float), history)
