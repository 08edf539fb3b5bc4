"""What a command leaves out: the muscle's past, its speed, and the errors of sensors.

A command is for a muscle at rest, seen through true sensors. Of what that leaves out, only friction has a
size that no history needs to be known for: dragged all the way, it adds its half loop to the force after
lengthening and takes as much away after shortening.

    half loop   w = [F(P, L; +s) − F(P, L; −s)] / 2      s the stress of every element at its limit
    a command   is off by up to w |∂(command)/∂F|        to either side: no standard deviation, but a way

Source: derived here; the balance and its frozen stresses are those of `model/bench.py`.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array

from pamjax.design.inverse import at_rest
from pamjax.model.bench import Bench
from pamjax.model.mechanism import AbstractMemory, AbstractSensor, AbstractSlip
from pamjax.model.mechanisms.braid_friction import BraidFriction
from pamjax.model.mechanisms.pressure_drop import PressureDrop
from pamjax.model.muscle import Muscle

#: Kinds that rest leaves out, beside sensors.
PAST = (AbstractMemory, AbstractSlip, PressureDrop)


def left_out(muscle: Muscle | Bench) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Ids of the mechanisms that take no part in a command: of past or speed, and of sensors."""
    if isinstance(muscle, Muscle):
        return (), ()
    past, sensors = ([m.id for m in muscle.mechanisms if isinstance(m, k)] for k in (PAST, AbstractSensor))
    return tuple(past), tuple(sensors)


def half_loop(muscle: Muscle | Bench, pressure: float, length: float) -> float:
    """Half the width of the friction's loop in force, N, at a true pressure (Pa) and length (m), or 0."""
    if isinstance(muscle, Muscle) or not muscle.of(BraidFriction):
        return 0.0
    return float(_half_loop(muscle, jnp.asarray(pressure, float), jnp.asarray(length, float)))


@eqx.filter_jit
def _half_loop(muscle: Bench, pressure: Array, length: Array) -> Array:
    bench = muscle.prepared()
    past, _ = at_rest(bench, pressure, length)

    def stress(memory):
        nothing = jnp.zeros_like(memory.strains(past.state, past.pressure))
        return memory.dragged(past) if isinstance(memory, BraidFriction) else nothing

    frozen = bench.frozen(past, [stress(memory) for memory in bench.of(AbstractMemory)])

    def force(way):
        pulled = frozen[0] * way, frozen[1] * way
        return bench.instant(past.pressure, length, jnp.zeros_like(length), pulled)[0].force

    # Both ways side by side, so that the balance is compiled once.
    after_lengthening, after_shortening = jax.vmap(force)(jnp.array([1.0, -1.0]))
    return (after_lengthening - after_shortening) / 2
