"""Memory in parallel: recurrences that compose, so that a long recording needs no loop over its rows.

Each recurrence here is a map of the state before to the state after, from a family that is closed
under composition. So the recording is cut into some √n blocks that are walked side by side, the blocks'
own maps are then composed one after the other, and both are put together: 2 √n short vectorised steps.
Why not `lax.associative_scan`? It writes its log n sweeps out one by one, and takes many times as long
to compile, and to run.
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


def compose_maps(join: Callable[[Map, Map], Map], maps: Map, size: int = 0) -> Map:
    """Every map after all the maps before it, along the first axis.

    Args:
        join: (first, second) → the map that does first, then second; for arrays of any shape.
        maps: arrays of shape (n, ...).
        size: rows of a block; about √n if zero.
    """
    n = len(jax.tree.leaves(maps)[0])
    size = size or max(1, math.isqrt(n))
    blocks = -(-n // size)

    def cut(x):
        # Repeated last rows fill the last block, and are dropped again.
        filled = jnp.concatenate([x, jnp.broadcast_to(x[-1:], (blocks * size - n, *x.shape[1:]))])
        return jnp.swapaxes(filled.reshape(blocks, size, *x.shape[1:]), 0, 1)

    def walk(maps):
        first, rest = jax.tree.map(lambda x: x[0], maps), jax.tree.map(lambda x: x[1:], maps)

        def step(before, here):
            after = join(before, here)
            return after, after

        later = jax.lax.scan(step, first, rest)[1]
        return jax.tree.map(lambda x, y: jnp.concatenate([x[None], y]), first, later)

    inside = walk(jax.tree.map(cut, maps))
    until = walk(jax.tree.map(lambda x: x[-1], inside))
    later = join(jax.tree.map(lambda x: x[None, :-1], until), jax.tree.map(lambda x: x[:, 1:], inside))
    whole = jax.tree.map(lambda x, y: jnp.concatenate([x[:, :1], y], axis=1), inside, later)
    return jax.tree.map(lambda x: jnp.swapaxes(x, 0, 1).reshape(-1, *x.shape[2:])[:n], whole)


def running_max(values: Rows, restart: Bool[Array, " n"]) -> Rows:
    """Largest value so far, counted anew at every restart."""
    return _running_max(values, _broadcast_flags(restart, values))


@jax.custom_jvp
def _running_max(values: Array, anew: Array) -> Array:
    def join(a, b):
        (first, before), (second, anew) = a, b
        return jnp.where(anew, second, jnp.maximum(first, second)), before | anew

    return compose_maps(join, (values, anew))[0]


@_running_max.defjvp
def _running_max_jvp(primals, tangents):
    largest = _running_max(*primals)
    return largest, _carry_last(tangents[0], primals[0] >= largest)


def relax_states(kicks: Rows, keep: Rows, restart: Bool[Array, " n"]) -> Rows:
    """State of s ← keep · s + kick, from zero; anew at every restart.

    The map s → a s + b composes to another such map.
    """
    keep = jnp.where(_broadcast_flags(restart, keep), 0.0, keep)
    return _relax_states(*jnp.broadcast_arrays(kicks, keep))


def _compute_relaxed(kicks: Array, keep: Array) -> Array:
    def join(first, second):
        return second[0] * first[0], second[0] * first[1] + second[1]

    return compose_maps(join, (keep, kicks))[1]


_relax_states = jax.custom_jvp(_compute_relaxed)


@_relax_states.defjvp
def _relax_states_jvp(primals, tangents):
    """The tangent of a relaxing state relaxes with the same factors: one such recurrence more, not three."""
    kicks, keep = primals
    s = _relax_states(kicks, keep)
    before = jnp.concatenate([jnp.zeros_like(s[:1]), s[:-1]])
    return s, _compute_relaxed(tangents[0] + tangents[1] * before, keep)


def apply_stop_operator(
    moved: Float[Array, " n"],
    stiffness: Float[Array, "*k"],
    width: Rows,
    restart: Bool[Array, " n"],
    start: Rows | float = 0.0,
) -> Rows:
    """States of s ← clip(s + stiffness · moved, −width, width); `start` at every restart.

    This is the stop operator, the element of rate-independent friction: an elastic stretch that slips
    at its width. The map s → clip(s + a, low, high) composes to another such map: shifting then
    clipping twice is shifting by the sum and clipping once, at limits that were themselves clipped.
    """
    width, start = jnp.broadcast_arrays(width, jnp.asarray(start))
    return _apply_stop_operator(moved, stiffness, width, start, restart)


@jax.custom_jvp
def _apply_stop_operator(moved: Array, stiffness: Array, width: Array, start: Array, restart: Array) -> Array:
    anew = _broadcast_flags(restart, width)
    shift = jnp.where(anew, start, stiffness * _broadcast_flags(moved, width))
    low, high = jnp.where(anew, start, -width), jnp.where(anew, start, width)

    def join(first, second):
        (a1, l1, h1), (a2, l2, h2) = first, second
        return a1 + a2, jnp.clip(l1 + a2, l2, h2), jnp.clip(h1 + a2, l2, h2)

    a, low, high = compose_maps(join, (shift, low, high))
    return jnp.clip(a, low, high)


@_apply_stop_operator.defjvp
def _apply_stop_operator_jvp(primals, tangents):
    """Since its last slip a stop moves with the signal; where it slipped it moves with the width.

    A sum and a look back: much cheaper, for each of many numbers, than the recurrence itself.
    """
    moved, stiffness, width, _, restart = primals
    moved_dot, stiffness_dot, width_dot, start_dot, _ = tangents
    s, anew = _apply_stop_operator(*primals), _broadcast_flags(restart, width)
    slips = jnp.abs(s) >= width

    def path(moved):
        return _broadcast_flags(compose_maps(jnp.add, moved), width)

    total = stiffness * path(moved_dot) + stiffness_dot * path(moved)
    # A stop that has not slipped yet hangs on its start: without a restart on zero, before the first row.
    offset = jnp.where(anew, start_dot, jnp.where(slips, jnp.sign(s) * width_dot, 0.0)) - total
    return s, total + _carry_last(offset, anew | slips)


def _carry_last(values: Array, is_new: Array) -> Array:
    """The value at the last row so far that was new; zero before the first."""
    row = jnp.arange(len(values)).reshape(-1, *[1] * (values.ndim - 1))
    last = compose_maps(jnp.maximum, jnp.where(is_new, row, -1))
    carried = jnp.take_along_axis(values, jnp.maximum(last, 0), axis=0)
    return jnp.where(last >= 0, carried, 0.0)


def _broadcast_flags(flags: Bool[Array, " n"], values: Array) -> Array:
    return jnp.broadcast_to(flags.reshape(-1, *[1] * (values.ndim - 1)), values.shape)
