"""The muscle: force and diameter from pressure and length, by one potential.

    Π(L, B; P) = B0 w(B/B0 − 1) + Σ terms(L, B) − P V(L, B)

The balance ∂Π/∂B = 0 determines the stretched thread length. The force is F = ∂Π/∂L at that length
(envelope theorem). All stored energies are terms of Π, so that force, strain and diameter are consistent.
"""

from __future__ import annotations

from typing import Protocol

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jax.core import Tracer
from jaxtyping import Array, Float, Int

from pamjax.errors import BadInput
from pamjax.jit import compile_on_call, get_default_device
from pamjax.model import braid
from pamjax.model.balance import BURST_LOAD_SHARE, Status, solve_strain, stretch_linear
from pamjax.model.bench import Bench
from pamjax.model.state import AbstractGeometry, AbstractTerm, Cylinder, State
from pamjax.model.thread import AbstractThread, Inextensible, LinearThread
from pamjax.parameter import Scalar, parameter
from pamjax.units import compute_si_factor, format_count, format_number

#: Balance residual, relative to the pull, above which a state counts as not solved.
_PULL_TOLERANCE = 1e-9
#: Number of states that fit into a processor's cache with the intermediate results of their derivatives.
CACHE_BLOCK_STATES = 8192
#: Display unit of each field of a reading, and the largest number of instants in its text.
_READING_UNITS = {"force": "N", "diameter": "mm", "thread": "mm", "strain": "1", "load": "N"}
_MAX_SHOWN_INSTANTS = 5
#: Minimum thread strain whose load scales the balance residual.
_PULL_SCALE_STRAIN = 1e-6


class MuscleReading(eqx.Module):
    """Predicted readings of a muscle at one instant, or at many from `predict`.

    Attributes:
        force: tension, positive pulls, N.
        diameter: outer mean diameter, m.
        thread: stretched length of one thread, m.
        strain: of the threads, B/B0 − 1.
        load: pull of all threads together, N.
        status: a `balance.Status`; if it is not OK, the values are those of the nearest valid state.
    """

    force: Float[Array, ...]
    diameter: Float[Array, ...]
    thread: Float[Array, ...]
    strain: Float[Array, ...]
    load: Float[Array, ...]
    status: Int[Array, ...]

    def __repr__(self) -> str:
        """Return the first values with their units, and the status in words."""
        if not isinstance(self.status, jax.Array | np.ndarray) or isinstance(self.status, Tracer):
            return super().__repr__()
        status = np.atleast_1d(np.asarray(self.status))
        lines = [f"MuscleReading: {format_count(status.size, 'instant')}"]
        for name, unit in _READING_UNITS.items():
            values = np.ravel(np.asarray(getattr(self, name))) / compute_si_factor(unit)
            numbers = ", ".join(format_number(value, 5) for value in values[:_MAX_SHOWN_INSTANTS])
            more = ", …" if values.size > _MAX_SHOWN_INSTANTS else ""
            lines.append(f"  {name:<8} {numbers}{more}{'' if unit == '1' else f' {unit}'}")
        lines += [
            f"  status   {code} ({np.sum(status == code)} of {status.size}): {Status(int(code)).message}"
            for code in np.unique(status)
        ]
        if status.size and not (status == Status.OK).any():
            lines.append("  No value is valid. Check the units: pressure is in Pa and length in m.")
        return "\n".join(lines)


class Muscle(eqx.Module):
    """A braided muscle at equilibrium.

    Attributes:
        rest_length: length at which contraction is zero, m.
        thread_length: length B0 of one unloaded thread, m.
        turns: turns N of one thread around the muscle.
        thread: law of the threads.
        geometry: geometry of the braid.
        terms: other stored energies.

    Neglects: memory (friction, relaxation, slip) and the rig.

    >>> from pamjax.model.thread import LinearThread
    >>> muscle = Muscle(0.235744, 0.251206, 1.09, LinearThread(144 * 0.0858e-6 * 80e9))
    >>> reading = muscle(689.48e3, 0.235744)
    >>> print(f"{float(reading.force):.0f} N, {1e3 * float(reading.diameter):.2f} mm")
    4753 N, 26.50 mm
    """

    rest_length: Scalar = parameter(
        "m", show="mm", low=1e-3, high=20.0, scale="log", about="length at which contraction is zero",
        source="miniature grippers to building-scale muscles",
    )  # fmt: skip
    thread_length: Scalar = parameter(
        "m", show="mm", low=1e-3, high=20.0, scale="log", about="length B0 of one unloaded thread",
        source="a little longer than the muscle",
    )  # fmt: skip
    turns: Scalar = parameter(
        "1", low=0.05, high=200.0, scale="log", about="turns N of one thread around the muscle",
        source="from B cos(angle) / (pi D)",
    )  # fmt: skip
    thread: AbstractThread | Inextensible = Inextensible()
    geometry: AbstractGeometry = Cylinder()
    terms: tuple[AbstractTerm, ...] = ()

    def state(self, length: Scalar, strain: Scalar) -> State:
        """Return the state at a length (m) and a thread strain."""
        return self.geometry(length, self.thread_length * (1 + strain), self.turns)

    def work(self, length: Scalar, strain: Scalar, pressure: Scalar) -> Array:
        """Return the potential without its threads, Σ terms − P V, J."""
        state = self.state(length, strain)
        return sum((term.energy(state) for term in self.terms), -pressure * state.volume)

    def potential(self, length: Scalar, strain: Scalar, pressure: Scalar) -> Array:
        """Return the potential Π, J. Its derivative by length is the force."""
        return self.thread_length * self.thread.energy(strain) + self.work(length, strain, pressure)

    def pull(self, length: Scalar, strain: Scalar, pressure: Scalar) -> Array:
        """Return the pull of pressure and terms on all threads together, −∂work/∂B, N."""
        return jax.grad(self.work, argnums=1)(length, strain, pressure) * (-1 / self.thread_length)

    def strain(self, pressure: Scalar, length: Scalar) -> tuple[Array, Array]:
        """Return the thread strain at equilibrium, and its `Status`."""
        unstrained_pull = self.pull(length, jnp.zeros_like(length), pressure)
        if isinstance(self.thread, Inextensible):
            return jnp.zeros_like(unstrained_pull), jnp.zeros_like(unstrained_pull, dtype=int)
        if isinstance(self.thread, LinearThread) and not self.terms and isinstance(self.geometry, Cylinder):
            return stretch_linear(unstrained_pull, self.thread.stiffness)
        return self._solve_strain(self.thread, pressure, length, unstrained_pull)

    def _solve_strain(
        self, thread: AbstractThread, pressure: Scalar, length: Scalar, unstrained_pull: Scalar
    ) -> tuple[Array, Array]:
        burst_pull = BURST_LOAD_SHARE * thread.stiffness
        stable, is_pulled = unstrained_pull <= burst_pull, unstrained_pull >= 0
        # Threads do not push, and beyond the burst load no equilibrium exists. A solvable problem replaces
        # both cases, so that values and derivatives are defined.
        share = jnp.where(stable, 1.0, burst_pull / jnp.where(stable, 1.0, unstrained_pull))
        pressure = jnp.where(is_pulled, share * pressure, 0.0)
        start = jnp.where(
            is_pulled, thread.initial_strain(jnp.where(is_pulled, share * unstrained_pull, 0.0)), 0.0
        )

        def residual(strain):
            return thread.load(strain) - self.pull(length, strain, pressure)

        root = solve_strain(residual, start, thread.newton_steps + 4 * bool(self.terms))
        scale = jnp.maximum(unstrained_pull, _PULL_SCALE_STRAIN * thread.stiffness)
        is_solved = jnp.abs(residual(root)) <= _PULL_TOLERANCE * scale
        status = jnp.where(is_solved | ~is_pulled, int(Status.OK), int(Status.NOT_CONVERGED))
        return jnp.where(is_pulled, root, 0.0), jnp.where(stable, status, int(Status.UNSTABLE))

    def __call__(self, pressure: Scalar, length: Scalar) -> MuscleReading:
        """Return the readings at one gauge pressure (Pa) and length (m)."""
        pressure, length = jnp.asarray(pressure, float), jnp.asarray(length, float)
        strain, status = self.strain(pressure, length)
        state = self.state(length, strain)
        force = jax.grad(self.work, argnums=0)(length, strain, pressure)
        straight = (state.thread <= length) & (status == int(Status.OK))
        return MuscleReading(
            force=force,
            diameter=state.diameter,
            thread=state.thread,
            strain=strain,
            load=self.pull(length, strain, pressure),
            status=jnp.where(straight, int(Status.STRAIGHT), status),
        )


def contraction(muscle: Muscle, length: braid.Real) -> Array:
    """Return the contraction, 1 − L / L_rest."""
    return 1 - jnp.asarray(length) / muscle.rest_length


class MuscleHolder(Protocol):
    """An object with a muscle, such as the result of `load_muscle`."""

    @property
    def muscle(self) -> Muscle | Bench:
        """Return the muscle; a bench if it has mechanisms."""
        ...


def predict(
    muscle: Muscle | Bench | MuscleHolder, pressure: Float[Array, " n"], length: Float[Array, " n"]
) -> MuscleReading:
    """Return the readings of a muscle at many instants.

    An instant without an equilibrium has a `status` that is not OK.

    Args:
        muscle: the result of `assemble`, or of `load_muscle` without mechanisms.
        pressure: (n,) gauge pressure, Pa; or one number for all lengths.
        length: (n,) length between the fittings, m; or one number for all pressures.

    Returns:
        a `MuscleReading` whose fields have shape (n,): force N, diameter m, thread length m, status.

    Raises:
        BadInput: if `pressure` and `length` have different lengths, or if the muscle has mechanisms.

    Example:
        loaded = pamjax.load_muscle("mine")
        reading = pamjax.predict(loaded, [200e3, 400e3], 0.18)  # Pa, m
        print(reading.force, reading.status)  # N
    """
    bare_muscle = muscle if isinstance(muscle, Muscle | Bench) else muscle.muscle
    if isinstance(bare_muscle, Bench):
        raise BadInput.from_rule(
            "`predict` needs a muscle without mechanisms",
            ", ".join(mechanism.id for mechanism in bare_muscle.mechanisms),
            remedy="Call `pamjax.simulate` for a muscle with mechanisms.",
        )
    inputs = jnp.atleast_1d(jnp.asarray(pressure, float), jnp.asarray(length, float))
    if len({x.shape for x in inputs if x.shape != (1,)}) > 1 or max(x.ndim for x in inputs) > 1:
        shapes = " and ".join(str(x.shape) for x in inputs)
        raise BadInput.from_rule(
            "`pressure` and `length` must have equal lengths, or one must be a single number",
            shapes,
            remedy="Pass one pressure for each length.",
        )
    return _predict_batch(bare_muscle, *jnp.broadcast_arrays(*inputs))


@compile_on_call
def _predict_batch(muscle: Muscle, *inputs: Float[Array, " n"]) -> MuscleReading:
    if len(inputs[0]) < 4 * CACHE_BLOCK_STATES or get_default_device().platform != "cpu":
        return jax.vmap(muscle)(*inputs)
    # XLA writes intermediate results that two outputs share to memory. Those of one block stay in the cache.
    # `checkpoint` computes them again for derivatives: a gradient takes a third of the time.
    return jax.lax.map(jax.checkpoint(lambda state: muscle(*state)), inputs, batch_size=CACHE_BLOCK_STATES)
