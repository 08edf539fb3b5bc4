"""Effects that a command neglects: memory, speed, errors of sensors and compliance of the rig.

A command assumes a muscle at rest, rigid ends and exact sensors. Only the effect of friction has a bound
without a known history. Fully developed sliding adds half the loop's width to the force after lengthening,
and subtracts it after shortening.

    half loop          w = [F(P, L; +s) − F(P, L; −s)] / 2      s: stress of every element at its limit
    error of command   at most w |∂(command)/∂F|                its sign depends on the direction of motion

Source: derived here, with the equilibrium and the frozen stresses of `model/bench.py`.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array
from numpy.typing import ArrayLike

from pamjax.control.inverse import remove_rig, solve_at_rest
from pamjax.jit import compile_on_call
from pamjax.model.bench import Bench
from pamjax.model.mechanism import AbstractMemory, AbstractRigCompliance, AbstractSensor, AbstractSlip
from pamjax.model.mechanisms.braid_friction import BraidFriction
from pamjax.model.mechanisms.pressure_drop import PressureDrop
from pamjax.model.muscle import Muscle

#: Classes of mechanisms that a muscle at rest neglects, and those of sensors and rig.
_NEGLECTED_HISTORY, _NEGLECTED_RIG = (
    (AbstractMemory, AbstractSlip, PressureDrop),
    (AbstractSensor, AbstractRigCompliance),
)


def list_neglected(muscle: Muscle | Bench) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the ids of the neglected mechanisms: those of memory or speed, and those of sensors and rig."""
    if isinstance(muscle, Muscle):
        return (), ()
    history, rig = (
        [m.id for m in muscle.mechanisms if isinstance(m, k)] for k in (_NEGLECTED_HISTORY, _NEGLECTED_RIG)
    )
    return tuple(history), tuple(rig)


def compute_friction_half_loop(muscle: Muscle | Bench, pressure: ArrayLike, length: ArrayLike) -> np.ndarray:
    """Return half the width of the friction loop in force, N, (n,); 0 without friction."""
    p, l = (jnp.atleast_1d(jnp.asarray(x, float)) for x in (pressure, length))
    if isinstance(muscle, Muscle) or not muscle.find_mechanisms(BraidFriction):
        return np.zeros(p.shape)
    return np.asarray(_compute_half_loops(muscle, p, l))


@compile_on_call
def _compute_half_loops(muscle: Bench, pressure: Array, length: Array) -> Array:
    return jax.vmap(lambda p, l: compute_half_loop(muscle, p, l))(pressure, length)


def compute_half_loop(muscle: Bench, pressure: Array, length: Array) -> Array:
    """Return half the width of the friction loop at one pressure, Pa, and length, m; N."""
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

    # Both directions in one call, so that the equilibrium is compiled once.
    after_lengthening, after_shortening = jax.vmap(force)(jnp.array([1.0, -1.0]))
    return (after_lengthening - after_shortening) / 2
