"""The length of a muscle at a set force: a free contraction, or a muscle that carries a weight.

The models predict the force F(P, L) at a pressure and a length. In an isotonic test the force F_set is set
and the length is measured. One step of Newton's method from the measured length L is the predicted length:

    L̂ = L + (F_set − F(P, L)) / K,     K = ∂F₀/∂L at constant P.

| symbol | meaning                                                        | unit |
|--------|----------------------------------------------------------------|------|
| F      | force of the bench, memories (friction, relaxation) included   | N    |
| F₀     | force of the bench without memories                            | N    |
| K      | stiffness of the muscle at constant pressure                   | N/m  |

The measured length is the input of the memories. In a loop, the direction of friction is thus that of the
measured motion, and no equation with memory must be solved.

Limits: the error of the step is about (L̂ − L)² F″ / (2 K). For a bare braid that is (L̂ − L)² / (2 L), or
5 µm for a misfit of 1 mm at 100 mm. Noise of the length reaches the prediction only through the memories.
Neglects: the stiffness of friction before it slides. A muscle without pressure has no stiffness: there K is
at least `MIN_STIFFNESS`, and the prediction has no meaning.
Source: Newton's method; derived here. K is a central difference of fourth order, with an error of about 1e-10
of K. It compiles in half of the time of an exact derivative. Within 0.2 % of the length at which the force
has a corner, K is a mean of both sides.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
from jaxtyping import Array, Int

from pamjax.jit import compile_on_call
from pamjax.model.balance import Status
from pamjax.model.bench import Bench, remove_memories
from pamjax.model.history import History
from pamjax.model.mechanism import Samples
from pamjax.model.muscle import Muscle

Result = TypeVar("Result")

#: Smallest stiffness, N/m.
MIN_STIFFNESS = 1.0

#: Central difference of fourth order: step as a share of the length, its multiples and their weights.
_DIFFERENCE_SHARE = 1e-3
_DIFFERENCE_STEPS, _DIFFERENCE_WEIGHTS = (-2, -1, 1, 2), (1 / 12, -2 / 3, 2 / 3, -1 / 12)

#: A simulated length is solved if Newton's step is below this share of it; largest number of steps.
_LENGTH_TOLERANCE, _MAX_LENGTH_STEPS = 1e-9, 400
#: Largest step of the length, relative to the length, and growth of the damping if the steps do not decrease.
_MAX_STEP_SHARE, _DAMPING_GROWTH = 0.1, 1.5


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
    muscle: Muscle | Bench, pressure: Samples, length: Samples, set_force: Samples, history: History
) -> LengthReading:
    """Return the length at which the model's force is the set force, to first order.

    Args:
        muscle: the muscle, or a bench with the muscle.
        pressure: (n,) gauge pressure, Pa.
        length: (n,) measured length, m.
        set_force: (n,) N.
        history: time and order of the samples.
    """
    is_bare = isinstance(muscle, Muscle)
    reading = jax.vmap(muscle)(pressure, length) if is_bare else muscle(pressure, length, history)
    stiffness = compute_stiffness(muscle, pressure, length, history)
    predicted_length = length + (set_force - reading.force) / stiffness
    return LengthReading(predicted_length, reading.diameter, stiffness, reading.status)


def compute_stiffness(muscle: Muscle | Bench, pressure: Samples, length: Samples, history: History) -> Array:
    """Return the stiffness at constant pressure without memories, (n,) N/m, at least `MIN_STIFFNESS`.

    Args:
        muscle, pressure, length, history: as for `predict_length`.
    """

    def compute_force(x):
        if isinstance(muscle, Muscle):
            return jax.vmap(muscle)(pressure, x).force
        return remove_memories(muscle)(pressure, x, history).force

    # All lengths change alike: a delay of the force channel mixes rows.
    offsets = _DIFFERENCE_SHARE * length * jnp.array(_DIFFERENCE_STEPS)[:, None]
    forces = jax.vmap(compute_force)(length + offsets)
    stiffness = jnp.array(_DIFFERENCE_WEIGHTS) @ forces / (_DIFFERENCE_SHARE * length)
    return jnp.where(stiffness > MIN_STIFFNESS, stiffness, MIN_STIFFNESS)


def solve_lengths(
    muscle: Muscle | Bench, pressure: Samples, start: Samples, set_force: Samples, history: History
) -> tuple[LengthReading, Array]:
    """Return the readings of a muscle at a set force, and whether each length is solved, (n,) bool.

    Repeats the step of `predict_length` from its own result, with more damping in a row whose step increases.
    The reason is friction before it slides, which is stiffer than K.

    Args:
        muscle: the muscle, or a bench with the muscle.
        pressure: (n,) gauge pressure, Pa.
        start: (n,) lengths at which the search starts, m.
        set_force: (n,) N.
        history: time and order of the samples.
    """
    pressure, start, set_force = (jnp.asarray(x, float) for x in (pressure, start, set_force))

    def take_step(length: Samples) -> tuple[Samples, LengthReading]:
        reading = _step_length(muscle, pressure, length, set_force, history)
        return reading.length, reading

    reading, is_solved = repeat_steps(take_step, start, _LENGTH_TOLERANCE, _MAX_LENGTH_STEPS)
    return reading, is_solved & (reading.status == int(Status.OK))


def repeat_steps(
    take_step: Callable[[Samples], tuple[Samples, Result]], start: Samples, tolerance: float, max_steps: int
) -> tuple[Result, Array]:
    """Return the result of the last step, and whether each length is solved, (n,) bool.

    Args:
        take_step: function from lengths, (n,) m, to the next lengths and any other result.
        start: (n,) lengths at which the search starts, m.
        tolerance: a length is solved if its step is below this share of it.
        max_steps: largest number of steps, at least one.
    """
    length, damping, size = start, jnp.ones_like(start), jnp.full_like(start, jnp.inf)
    result: Result | None = None
    for _ in range(max_steps):
        next_length, result = take_step(length)
        limit = _MAX_STEP_SHARE * length
        step = jnp.clip(jnp.nan_to_num(next_length - length), -limit, limit)
        previous_size, size = size, jnp.abs(step / length)
        if jnp.max(size) < tolerance:
            break
        damping = jnp.where(size > previous_size, damping * _DAMPING_GROWTH, damping)
        length = length + step / damping
    assert result is not None
    return result, size < tolerance


_step_length = compile_on_call(predict_length)
