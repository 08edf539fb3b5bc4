"""The length of a muscle at a set force: a free contraction, or a muscle that carries a weight.

The models predict the force F(P, L) at a pressure and a length. In an isotonic test the force F_set is set
and the length is measured. One step of Newton's method from the measured length L is the predicted length:

    L̂ = L + (F_set − F(P, L)) / K,     K = [F₀(P, L + h) − F₀(P, L − h)] / (2 h).

| symbol | meaning                                                        | unit |
|--------|----------------------------------------------------------------|------|
| F      | force of the bench, memories (friction, relaxation) included   | N    |
| F₀     | force of the bench without memories                            | N    |
| K      | stiffness of the muscle at constant pressure                   | N/m  |
| h      | `STEP_SHARE` of the length                                     | m    |

The measured length is the input of the memories. In a loop, the direction of friction is thus that of the
measured motion, and no equation with memory must be solved.

Limits: the error of the step is about (L̂ − L)² F″ / (2 K), that is (L̂ − L)² / (2 L) for a bare braid: 5 µm
for a misfit of 1 mm at 100 mm. Noise of the length reaches the prediction only through the memories.
Neglects: the stiffness of friction before it slides. A muscle without pressure has no stiffness: there K is
at least `MIN_STIFFNESS`, and the prediction has no meaning.
Source: Newton's method; derived here.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from pamjax.jit import compile_on_call
from pamjax.model.balance import Status
from pamjax.model.bench import Bench, remove_memories
from pamjax.model.history import History
from pamjax.model.mechanism import Samples
from pamjax.model.muscle import Muscle

#: Half the distance of the two lengths that give the stiffness, relative to the length.
STEP_SHARE = 1e-4
#: Smallest stiffness, N/m.
MIN_STIFFNESS = 1.0

#: A simulated length is solved if Newton's step is below this share of it; largest number of steps.
LENGTH_TOLERANCE, MAX_LENGTH_STEPS = 1e-9, 400
#: Largest step of the length, relative to the length, and growth of the damping if the steps do not decrease.
MAX_STEP_SHARE, DAMPING_GROWTH = 0.1, 1.5


class LengthReading(eqx.Module):
    """Predicted readings of an isotonic test at every sample.

    Attributes:
        length: (n,) predicted length at the set force, m.
        diameter: (n,) recorded outer diameter at the measured length, m.
        stiffness: (n,) stiffness K of the muscle at constant pressure, N/m.
        status: (n,) a `balance.Status`.
    """

    length: Samples
    diameter: Samples
    stiffness: Samples
    status: Int[Array, " n"]


def predict_length(
    predict: Callable[[Samples], Any],
    predict_static: Callable[[Samples], Any],
    length: Float[Array, " n"],
    set_force: Float[Array, " n"],
) -> LengthReading:
    """Return the length at which the model's force is the set force, to first order.

    Args:
        predict: reading (force in N, diameter in m, status) at lengths, (n,) m.
        predict_static: the same without memories.
        length: (n,) measured length, m.
        set_force: (n,) N.
    """
    reading = predict(length)
    stiffness = compute_stiffness(predict_static, length)
    predicted_length = length + (set_force - reading.force) / stiffness
    return LengthReading(predicted_length, reading.diameter, stiffness, reading.status)


def compute_stiffness(predict_static: Callable[[Samples], Any], length: Float[Array, " n"]) -> Array:
    """Return the stiffness at constant pressure, (n,) N/m, at least `MIN_STIFFNESS`.

    Args:
        predict_static: reading at lengths, (n,) m, without memories.
        length: (n,) m.
    """
    step = STEP_SHARE * length
    # With a loop the static model is compiled once for both lengths.
    above, below = jax.lax.map(lambda x: predict_static(x).force, jnp.stack([length + step, length - step]))
    stiffness = (above - below) / (2 * step)
    return jnp.where(stiffness > MIN_STIFFNESS, stiffness, MIN_STIFFNESS)


def solve_lengths(
    muscle: Muscle | Bench, pressure: Samples, start: Samples, set_force: Samples, history: History
) -> tuple[LengthReading, Array]:
    """Return the readings of a muscle at a set force, and whether each length is solved, (n,) bool.

    Repeats the step of `predict_length` from its own result, with more damping in a row whose step increases:
    friction before it slides is stiffer than K.

    Args:
        muscle: the muscle, or a bench with the muscle.
        pressure: (n,) gauge pressure, Pa.
        start: (n,) lengths at which the search starts, m.
        set_force: (n,) N.
        history: time and order of the samples.
    """
    pressure, length, set_force = (jnp.asarray(x, float) for x in (pressure, start, set_force))
    damping, previous_size = jnp.ones_like(length), jnp.full_like(length, jnp.inf)
    reading, step = None, jnp.zeros_like(length)
    for _ in range(MAX_LENGTH_STEPS):
        reading = _step_length(muscle, pressure, length, set_force, history)
        limit = MAX_STEP_SHARE * length
        step = jnp.clip(jnp.nan_to_num(reading.length - length), -limit, limit)
        size = jnp.abs(step / length)
        if jnp.max(size) < LENGTH_TOLERANCE:
            break
        damping = jnp.where(size > previous_size, damping * DAMPING_GROWTH, damping)
        previous_size, length = size, length + step / damping
    assert reading is not None
    is_solved = (jnp.abs(step / length) < LENGTH_TOLERANCE) & (reading.status == int(Status.OK))
    return reading, is_solved


@compile_on_call
def _step_length(
    muscle: Muscle | Bench, pressure: Samples, length: Samples, set_force: Samples, history: History
) -> LengthReading:
    """Return one step of Newton's method for the lengths at the set force."""
    if isinstance(muscle, Muscle):

        def predict_ideal(x):
            return jax.vmap(muscle)(pressure, x)

        return predict_length(predict_ideal, predict_ideal, length, set_force)
    static = remove_memories(muscle)
    return predict_length(
        lambda x: muscle(pressure, x, history), lambda x: static(pressure, x, history), length, set_force
    )
