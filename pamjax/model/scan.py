"""Recurrences for mechanisms with memory, computed for a whole recording in 2 √n vectorised steps.

Each recurrence is a map from the state before to the state after. The maps of one family are closed under
composition. The recording is divided into about √n blocks, in which the maps are composed in parallel. The
maps of the blocks are then composed in order, and joined with those inside. `lax.associative_scan` does the
same, but unrolls its log n sweeps, and takes several times as long to compile and to run.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TypeVar

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

Rows = Float[Array, "n *k"]
Map = TypeVar("Map")


def _compose_maps(join: Callable[[Map, Map], Map], maps: Map, size: int = 0) -> Map:
    """Return the composition of each map with all maps before it, along the first axis.

    Args:
        join: (first, second) → their composition, first applied first; for arrays of any shape.
        maps: arrays of shape (n, ...).
        size: rows of a block; about √n if zero.
    """
    n = len(jax.tree.leaves(maps)[0])
    size = size or max(1, math.isqrt(n))
    blocks = -(-n // size)

    def split(x):
        # Copies of the last row fill the last block. They are removed at the end.
        filled_rows = jnp.concatenate([x, jnp.broadcast_to(x[-1:], (blocks * size - n, *x.shape[1:]))])
        return jnp.swapaxes(filled_rows.reshape(blocks, size, *x.shape[1:]), 0, 1)

    def compose_in_order(maps):
        first, others = jax.tree.map(lambda x: x[0], maps), jax.tree.map(lambda x: x[1:], maps)

        def step(before, current):
            after = join(before, current)
            return after, after

        later = jax.lax.scan(step, first, others)[1]
        return jax.tree.map(lambda x, y: jnp.concatenate([x[None], y]), first, later)

    within_blocks = compose_in_order(jax.tree.map(split, maps))
    block_ends = compose_in_order(jax.tree.map(lambda x: x[-1], within_blocks))
    later = join(
        jax.tree.map(lambda x: x[None, :-1], block_ends), jax.tree.map(lambda x: x[:, 1:], within_blocks)
    )
    joined_maps = jax.tree.map(lambda x, y: jnp.concatenate([x[:, :1], y], axis=1), within_blocks, later)
    return jax.tree.map(lambda x: jnp.swapaxes(x, 0, 1).reshape(-1, *x.shape[2:])[:n], joined_maps)


def running_max(values: Rows, restart: Bool[Array, " n"]) -> Rows:
    """Return the largest value so far since the last restart."""
    return _running_max(values, _broadcast_flags(restart, values))


@jax.custom_jvp
def _running_max(values: Array, restarts: Array) -> Array:
    def join(a, b):
        (first, before), (second, restarts) = a, b
        return jnp.where(restarts, second, jnp.maximum(first, second)), before | restarts

    return _compose_maps(join, (values, restarts))[0]


@_running_max.defjvp
def _running_max_jvp(primals, tangents):
    largest = _running_max(*primals)
    return largest, _carry_last(tangents[0], primals[0] >= largest)


def relax_states(increments: Rows, decay: Rows, restart: Bool[Array, " n"]) -> Rows:
    """Return the states of s ← decay · s + increment, from zero at the start and at every restart.

    Args:
        increments: input of each step.
        decay: factor of each step.
        restart: (n,) whether the state restarts at zero.

    Compositions of maps s → a s + b have the same form.
    """
    decay = jnp.where(_broadcast_flags(restart, decay), 0.0, decay)
    return _relax_states(*jnp.broadcast_arrays(increments, decay))


def _compute_relaxed(increments: Array, decay: Array) -> Array:
    def join(first, second):
        return second[0] * first[0], second[0] * first[1] + second[1]

    return _compose_maps(join, (decay, increments))[1]


_relax_states = jax.custom_jvp(_compute_relaxed)


@_relax_states.defjvp
def _relax_states_jvp(primals, tangents):
    """Return state and tangent. The tangent follows the same recurrence with the same factors."""
    increments, decay = primals
    s = _relax_states(increments, decay)
    before = jnp.concatenate([jnp.zeros_like(s[:1]), s[:-1]])
    return s, _compute_relaxed(tangents[0] + tangents[1] * before, decay)


def apply_stop_operator(
    displacements: Float[Array, " n"],
    stiffness: Float[Array, "*k"],
    width: Rows,
    restart: Bool[Array, " n"],
    start: Rows | float = 0.0,
    low: Rows | None = None,
) -> Rows:
    """Return the states of s ← clip(s + stiffness · displacement, low, width); `start` at every restart.

    The limit `low` is −width unless it is given. This is the stop operator, the element of rate-independent
    friction: an elastic deflection that slips at its limits. Compositions of maps s → clip(s + a, low, high)
    have the same form. The shifts add, and the limits of the first are shifted and clipped by the second.
    """
    high, low, start = jnp.broadcast_arrays(width, -width if low is None else low, jnp.asarray(start))
    return _apply_stop_operator(displacements, stiffness, low, high, start, restart)


@jax.custom_jvp
def _apply_stop_operator(
    displacements: Array, stiffness: Array, low: Array, high: Array, start: Array, restart: Array
) -> Array:
    restarts = _broadcast_flags(restart, high)
    shift = jnp.where(restarts, start, stiffness * _broadcast_flags(displacements, high))
    low, high = jnp.where(restarts, start, low), jnp.where(restarts, start, high)

    def join(first, second):
        (a1, l1, h1), (a2, l2, h2) = first, second
        return a1 + a2, jnp.clip(l1 + a2, l2, h2), jnp.clip(h1 + a2, l2, h2)

    a, low, high = _compose_maps(join, (shift, low, high))
    return jnp.clip(a, low, high)


@_apply_stop_operator.defjvp
def _apply_stop_operator_jvp(primals, tangents):
    """Return state and tangent: since its last slip a stop follows the signal, and at the slip its limit.

    It is computed by a sum and one index per row, which is much faster than the recurrence.
    """
    displacements, stiffness, low, high, _, restart = primals
    displacements_dot, stiffness_dot, low_dot, high_dot, start_dot, _ = tangents
    s, restarts = _apply_stop_operator(*primals), _broadcast_flags(restart, high)
    slips = (s >= high) | (s <= low)
    limit_dot = jnp.where(s > 0, high_dot, jnp.where(s < 0, low_dot, 0.0))

    def path(displacements):
        return _broadcast_flags(_compose_maps(jnp.add, displacements), high)

    total = stiffness * path(displacements_dot) + stiffness_dot * path(displacements)
    # A stop that has not slipped yet depends on its start; without a restart it starts at zero.
    offset = jnp.where(restarts, start_dot, jnp.where(slips, limit_dot, 0.0)) - total
    return s, total + _carry_last(offset, restarts | slips)


def _carry_last(values: Array, is_new: Array) -> Array:
    """Return the value at the latest row that is new; zero before the first."""
    row = jnp.arange(len(values)).reshape(-1, *[1] * (values.ndim - 1))
    last = _compose_maps(jnp.maximum, jnp.where(is_new, row, -1))
    carried_values = jnp.take_along_axis(values, jnp.maximum(last, 0), axis=0)
    return jnp.where(last >= 0, carried_values, 0.0)


def _broadcast_flags(flags: Bool[Array, " n"], values: Array) -> Array:
    return jnp.broadcast_to(flags.reshape(-1, *[1] * (values.ndim - 1)), values.shape)
