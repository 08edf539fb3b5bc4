"""All numbers of one command in one program: command, reached force, slopes of the stiffness, and friction.

One program shares the equilibrium between its parts, and its trace is kept on disk. A later process with the
same kind of muscle traces nothing, which saves most of its time.
"""

from __future__ import annotations

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from pamjax.compile.programs import run_compiled
from pamjax.control.inverse import (
    Command,
    Inverse,
    compute_static_force,
    compute_stiffness_slopes,
    solve_lengths,
    solve_pressures,
)
from pamjax.control.neglected import compute_half_loop
from pamjax.model.bench import Bench
from pamjax.model.mechanisms.braid_friction import BraidFriction


class CommandNumbers(NamedTuple):
    """The numbers of one command, SI.

    Attributes:
        command: value, derivatives and status, each (1,).
        reached_force: force at the value and the given quantity, N.
        stiffness_slopes: (2,) derivatives of the stiffness by pressure and length.
        half_loop: half the width of the friction loop in force, N; 0 without friction.
    """

    command: Command
    reached_force: Array
    stiffness_slopes: Array
    half_loop: Array


def evaluate_command(inverse: Inverse, force: float, given: float, by_length: bool) -> CommandNumbers:
    """Return the numbers of one command.

    Args:
        inverse: the inverse model.
        force: wanted force, N.
        given: given length, m, if `by_length`, else given pressure, Pa.
    """
    program = _evaluate_pressure if by_length else _evaluate_length
    arguments = inverse.muscle, inverse.pressures, inverse.lengths, (force,), (given,)
    # The stored trace has plain tuples only.
    values = run_compiled(program, *jax.tree.map(lambda x: jnp.asarray(x, float), arguments))
    command, *others = jax.tree.map(np.asarray, values)
    return CommandNumbers(Command(*command), *others)


@jax.jit
def _evaluate_pressure(muscle, pressures, lengths, force, length) -> tuple:
    command = solve_pressures(
        muscle, jnp.stack(pressures), jnp.stack(lengths), jnp.stack(force), jnp.stack(length)
    )
    return _collect_numbers(muscle, command, command.value[0], length[0])


@jax.jit
def _evaluate_length(muscle, pressures, lengths, force, pressure) -> tuple:
    command = solve_lengths(
        muscle, jnp.stack(pressures), jnp.stack(lengths), jnp.stack(force), jnp.stack(pressure)
    )
    return _collect_numbers(muscle, command, pressure[0], command.value[0])


def _collect_numbers(muscle, command: Command, pressure: Array, length: Array) -> tuple:
    """Return the command's fields as a tuple, then the other fields of `CommandNumbers`."""
    has_friction = isinstance(muscle, Bench) and bool(muscle.find_mechanisms(BraidFriction))
    half_loop = compute_half_loop(muscle, pressure, length) if has_friction else jnp.zeros(())
    fields = command.value, command.slope_by_force, command.slope_by_given, command.stiffness, command.status
    return (
        fields,
        compute_static_force(muscle, pressure, length)[0],
        compute_stiffness_slopes(muscle, jnp.stack([pressure, length])),
        half_loop,
    )
