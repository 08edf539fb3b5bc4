"""What a bench did over time, as the mechanisms that remember need it.

A recording is a sequence of samples with gaps where the rig was moved. Memory is carried across a gap
unless it is stated to restart there; a rate never reaches across one. Before the first sample the muscle
was at rest in that state, or, where that is stated, had been through the same recording once.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from pamjax.parameter import Scalar

#: A rate is the slope of a straight line through a sample and this many neighbours on each side.
REACH = 2


class History(eqx.Module):
    """Time, and what is known of the order of the samples.

    Attributes:
        time: (n,) s; zeros for a static map.
        step: (n,) time since the sample before, s; zero at the first.
        restart: (n,) whether memory begins anew at this sample.
        slope: (n, 2 REACH + 1) weights that turn a sample and its neighbours into a rate, 1/s; zero
            for those of another run.
        first, last: (n,) the ends of each sample's run; the sample itself in a static map.
        settled: whether the muscle had been through the recording once before.
    """

    time: Float[Array, " n"]
    step: Float[Array, " n"]
    restart: Bool[Array, " n"]
    slope: Float[Array, "n k"]
    first: Int[Array, " n"]
    last: Int[Array, " n"]
    settled: bool = eqx.field(static=True, default=False)

    def rate(self, values: Float[Array, " n"]) -> Float[Array, " n"]:
        """Change of a quantity in a second; zero in a static map."""
        n, around = values.shape[0], _once(jnp.pad(values, REACH))
        return sum((self.slope[:, k] * around[k : k + n] for k in range(2 * REACH + 1)), jnp.zeros(n))

    def late(self, values: Float[Array, " n"], lag: Scalar) -> Float[Array, " n"]:
        """What a quantity was `lag` seconds ago; at the ends of a run, what it is there.

        Between samples it is a cubic with the rates of its ends, so that the derivative in the lag is
        continuous: minus the rate at a lag of zero.
        """
        at = self.time - lag
        before = jnp.searchsorted(self.time, at, side="right") - 1
        before = jnp.clip(before, self.first, jnp.maximum(self.last - 1, self.first))
        after = jnp.minimum(before + 1, self.last)
        span = self.time[after] - self.time[before]
        share = jnp.where(span > 0, (at - self.time[before]) / jnp.where(span > 0, span, 1.0), 0.0)
        x = jnp.clip(share, 0.0, 1.0)
        y, rate = _once(values), _once(self.rate(values))
        bend = x * (1 - x) * span * ((1 - x) * rate[before] - x * rate[after])
        ease = x * x * (3 - 2 * x)
        return (1 - ease) * y[before] + ease * y[after] + bend

    def increments(self, values: Float[Array, " n"]) -> Float[Array, " n"]:
        """Change of a quantity since the sample before; zero where memory begins anew."""
        before = jnp.concatenate([values[:1], values[:-1]])
        return jnp.where(self.restart, 0.0, values - before)

    def twice(self) -> History:
        """The recording, and then the recording again: 2n samples.

        From its last state the muscle goes to its first at once: nothing is known of the way. (A static map
        stays one: each of its samples begins anew.)
        """
        n = self.time.shape[0]

        def again(early, late):
            return jnp.concatenate([early, late])

        still = jnp.all(self.restart)
        return History(
            time=again(self.time - (self.time[-1] - self.time[0]), self.time),
            step=again(self.step, self.step),
            restart=again(self.restart, self.restart.at[0].set(still)),
            slope=again(self.slope, self.slope),
            first=again(self.first, self.first + n),
            last=again(self.last, self.last + n),
        )


def history(
    time: np.ndarray | None,
    starts: np.ndarray,
    *,
    restart: bool = False,
    settled: bool = False,
    size: int | None = None,
) -> History:
    """The history of a recording.

    Args:
        time: (n,) s, increasing; None for a static map, in which nothing is remembered.
        starts: (n,) whether a continuous run begins at this sample.
        restart: whether memory begins anew at every run, rather than only at the first sample.
        settled: whether the muscle had been through the recording once before.
        size: length to pad to; padded samples repeat the last one.
    """
    n = starts.size
    size = size or n
    clock = np.zeros(n) if time is None else np.asarray(time, dtype=float)
    run = np.cumsum(starts)
    begin, end = (np.searchsorted(run, run, side=side) for side in ("left", "right"))
    row = np.arange(n)
    first = np.zeros(n, dtype=bool)
    first[:1] = True
    anew = np.ones(n, dtype=bool) if time is None else (starts | first if restart else first)
    return History(
        time=jnp.asarray(_pad(clock, size, clock[-1] if n else 0.0)),
        step=jnp.asarray(_pad(np.diff(clock, prepend=clock[:1]), size, 0.0)),
        restart=jnp.asarray(_pad(anew, size, False)),
        slope=jnp.asarray(_pad(_slopes(clock, run), size, 0.0)),
        first=jnp.asarray(_pad(row if time is None else begin, size, max(n - 1, 0))),
        last=jnp.asarray(_pad(row if time is None else end - 1, size, max(n - 1, 0))),
        settled=settled,
    )


def _once(values: Array) -> Array:
    """The same values, computed before they are looked up: else each look-up computes them again."""
    return jax.lax.optimization_barrier(values)


def _slopes(clock: np.ndarray, run: np.ndarray) -> np.ndarray:
    """Weights of the least-squares slope through a sample and its neighbours of the same run."""
    n = clock.size
    near = np.clip(np.arange(n)[:, None] + np.arange(-REACH, REACH + 1), 0, max(n - 1, 0))
    same = (run[near] == run[:, None]) & (near == np.arange(n)[:, None] + np.arange(-REACH, REACH + 1))
    count = same.sum(axis=1, keepdims=True)
    centred = np.where(same, clock[near], 0.0)
    centred = np.where(same, centred - centred.sum(axis=1, keepdims=True) / np.maximum(count, 1), 0.0)
    spread = (centred**2).sum(axis=1, keepdims=True)
    return np.where(spread > 0, centred / np.where(spread > 0, spread, 1.0), 0.0)


def _pad(values: np.ndarray, size: int, fill) -> np.ndarray:
    out = np.full((size, *values.shape[1:]), fill, dtype=values.dtype)
    out[: len(values)] = values
    return out
