"""What a command leaves out: the muscle's past, its speed, the errors of sensors and the give of a rig.

A command is for a muscle at rest between rigid ends, seen through true sensors. Of what that leaves out,
only friction has a size that no history needs to be known for: dragged all the way, it adds its half loop to
the force after lengthening and takes as much away after shortening.

    half loop   w = [F(P, L; +s) − F(P, L; −s)] / 2      s the stress of every element at its limit
    a command   is off by up to w |∂(command)/∂F|        to either side: no standard deviation, but a way

Source: derived here; the balance and its frozen stresses are those of `model/bench.py`.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import ArrayLike

from pamjax.control.inverse import remove_rig, solve_at_rest
from pamjax.model.bench import Bench
from pamjax.model.mechanism import AbstractMemory, AbstractRig, AbstractSensor, AbstractSlip
from pamjax.model.mechanisms.braid_friction import BraidFriction
from pamjax.model.mechanisms.pressure_drop import PressureDrop
from pamjax.model.muscle import Muscle

#: Kinds that rest leaves out; and those of the lab.
NEGLECTED_HISTORY, NEGLECTED_RIG = (AbstractMemory, AbstractSlip, PressureDrop), (AbstractSensor, AbstractRig)


def list_neglected(muscle: Muscle | Bench) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Ids of the mechanisms that take no part in a command: of past or speed, and of sensors and rig."""
    if isinstance(muscle, Muscle):
        return (), ()
    past, lab = (
        [m.id for m in muscle.mechanisms if isinstance(m, k)] for k in (NEGLECTED_HISTORY, NEGLECTED_RIG)
    )
    return tuple(past), tuple(lab)


def compute_friction_half_loop(muscle: Muscle | Bench, pressure: ArrayLike, length: ArrayLike) -> np.ndarray:
    """Half the width of the friction's loop in force, N, (n,), at true pressures and lengths; or 0."""
    p, l = (jnp.atleast_1d(jnp.asarray(x, float)) for x in (pressure, length))
    if isinstance(muscle, Muscle) or not muscle.find_mechanisms(BraidFriction):
        return np.zeros(p.shape)
    return np.asarray(_compute_half_loops(muscle, p, l))


@eqx.filter_jit
def _compute_half_loops(muscle: Bench, pressure: Array, length: Array) -> Array:
    return jax.vmap(lambda p, l: _compute_half_loop(muscle, p, l))(pressure, length)


def _compute_half_loop(muscle: Bench, pressure: Array, length: Array) -> Array:
    bench = remove_rig(muscle)
    past, _ = solve_at_rest(bench, pressure, length)

    def stress(memory):
        zeros = jnp.zeros_like(memory.strains(past.state, past.pressure))
        return memory.full_sliding_stress(past) if isinstance(memory, BraidFriction) else zeros

    memory_loads = bench.compute_memory_loads(
        past, [stress(memory) for memory in bench.find_mechanisms(AbstractMemory)]
    )

    def force(direction):
        signed_loads = memory_loads[0] * direction, memory_loads[1] * direction
        return bench.solve_instant(past.pressure, length, jnp.zeros_like(length), signed_loads)[0].force

    # Both ways side by side, so that the balance is compiled once.
    after_lengthening, after_shortening = jax.vmap(force)(jnp.array([1.0, -1.0]))
    return (after_lengthening - after_shortening) / 2
