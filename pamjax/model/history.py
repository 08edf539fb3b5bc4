"""What a bench did over time, as the mechanisms that remember need it.

A recording is a sequence of samples with gaps where the rig was moved. Memory is carried across a gap
unless it is stated to restart there; a rate never reaches across one. Before the first sample the muscle
was at rest in that state, or, where that is stated, had been through the same recording once. What it leaves
out: corners of strokes with five samples or fewer, at which a rate is that across the corner.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from pamjax.parameter import Scalar

#: What turns has a corner where a straight line leaves this many times the usual of it.
CORNER = 6.0
#: Share of a channel's range that is no noise but rounding.
ROUNDING = 1e-6
#: Share of a channel's range below which a step between two rests is one of its resolution.
COUNT = 0.02
#: A side of a sample is bent where a straight line leaves this many times the usual of it.
BENT = 3.0

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
        many: how many samples are worked out; those after them repeat the last. None for all, which alone
            has derivatives in reverse.
        lasting: whether anything leaves something to later samples; where nothing does, once through the
            recording is enough. None for yes, which alone has derivatives in reverse.
    """

    time: Float[Array, " n"]
    step: Float[Array, " n"]
    restart: Bool[Array, " n"]
    slope: Float[Array, "n k"]
    first: Int[Array, " n"]
    last: Int[Array, " n"]
    settled: bool = eqx.field(static=True, default=False)
    many: Int[Array, ""] | None = None
    lasting: Bool[Array, ""] | None = None

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
    turning: np.ndarray | None = None,
    size: int | None = None,
    padding: bool = True,
) -> History:
    """The history of a recording.

    Args:
        time: (n,) s, increasing; None for a static map, in which nothing is remembered.
        starts: (n,) whether a continuous run begins at this sample.
        restart: whether memory begins anew at every run, rather than only at the first sample.
        settled: whether the muscle had been through the recording once before.
        turning: (k, n) what may stroke, in any unit: a rate does not reach across its corners.
        size: length to pad to; padded samples repeat the last one.
        padding: whether padded samples are worked out as well, rather than only repeated.
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
        restart=jnp.asarray(_pad(anew, size, time is None)),
        slope=jnp.asarray(_pad(_slopes(clock, run, turning), size, 0.0)),
        first=jnp.asarray(_pad(row if time is None else begin, size, max(n - 1, 0))),
        last=jnp.asarray(_pad(row if time is None else end - 1, size, max(n - 1, 0))),
        settled=settled,
        many=None if padding else jnp.asarray(n),
    )


def _once(values: Array) -> Array:
    """The same values, computed before they are looked up: else each look-up computes them again."""
    return jax.lax.optimization_barrier(values)


def _slopes(clock: np.ndarray, run: np.ndarray, turning: np.ndarray | None = None) -> np.ndarray:
    """Weights of the least-squares slope through a sample and its neighbours of the same run.

    Beside a corner of what turns, only the neighbours on the sample's own side.
    """
    n = clock.size
    near = np.clip(np.arange(n)[:, None] + np.arange(-REACH, REACH + 1), 0, max(n - 1, 0))
    same = (run[near] == run[:, None]) & (near == np.arange(n)[:, None] + np.arange(-REACH, REACH + 1))
    both = _line(clock, near, same)
    if turning is None or n <= 2 * REACH:
        return both
    sides = [same & reach for reach in (np.arange(-REACH, REACH + 1) <= 0, np.arange(-REACH, REACH + 1) >= 0)]
    lines = [both, *(_line(clock, near, side) for side in sides)]
    off = _off_usual(clock, turning, near, list(zip(lines, (same, *sides), strict=True)))
    # A corner stands out of the noise of the straight lines; the sample is on the side that is straight, and
    # the other is not. One that lies at the corner itself is on neither: there what turns is at rest.
    side = 1 + np.argmin(off[1:], axis=0)
    straight, bent = off[1:].min(axis=0), off[1:].max(axis=0)
    corner = (off[0] > CORNER) & (straight < off[0] / 2) & (bent > np.maximum(BENT, 2 * straight))
    return np.where(corner[:, None], np.where((side == 1)[:, None], lines[1], lines[2]), both)


def _off_usual(clock, turning, near, lines) -> np.ndarray:
    """What straight lines leave of all that turns, (lines, n), where the first usually leaves one.

    Each channel counts in its own noise, or in the steps in which it is written.
    """
    total = np.zeros((len(lines), clock.size))
    for channel in turning:
        span = float(np.ptp(channel))
        if span > 0:
            around = [np.where(there, channel[near], 0.0) for _, there in lines]
            off = np.stack([_off(clock, a, near, *line) for a, line in zip(around, lines, strict=True)])
            total += (off / max(_usual(off[0]), ROUNDING * span, _resolution(channel))) ** 2
    off = np.sqrt(total)
    return off / max(_usual(off[0]), 1.0)


def _resolution(channel: np.ndarray) -> float:
    """The step in which a slow channel is written, which stands still between two of them; 0 without one."""
    step = np.abs(np.diff(channel))
    alone = (step[1:-1] > 0) & (step[:-2] == 0) & (step[2:] == 0) & (step[1:-1] < COUNT * np.ptp(channel))
    return float(np.median(step[1:-1][alone])) if alone.any() else 0.0


def _usual(off: np.ndarray) -> float:
    finite = off[np.isfinite(off)]
    return float(np.median(finite)) if finite.size else 0.0


def _off(clock, around, near, slope, there) -> np.ndarray:
    """Rms of what a straight line leaves of the values, (n,); infinite where two points make the line."""
    count = there.sum(axis=1)
    safe = np.maximum(count, 1)[:, None]
    moment = np.where(there, clock[near], 0.0)
    values = np.where(there, around - around.sum(axis=1, keepdims=True, where=there) / safe, 0.0)
    rate = (slope * around).sum(axis=1, keepdims=True)
    left = values - rate * np.where(there, moment - moment.sum(axis=1, keepdims=True) / safe, 0.0)
    rms = np.sqrt((left**2).sum(axis=1) / np.maximum(count - 2, 1))
    return np.where(count > 2, rms, np.inf)


def _line(clock: np.ndarray, near: np.ndarray, same: np.ndarray) -> np.ndarray:
    count = same.sum(axis=1, keepdims=True)
    centred = np.where(same, clock[near], 0.0)
    centred = np.where(same, centred - centred.sum(axis=1, keepdims=True) / np.maximum(count, 1), 0.0)
    spread = (centred**2).sum(axis=1, keepdims=True)
    return np.where(spread > 0, centred / np.where(spread > 0, spread, 1.0), 0.0)


def _pad(values: np.ndarray, size: int, fill) -> np.ndarray:
    out = np.full((size, *values.shape[1:]), fill, dtype=values.dtype)
    out[: len(values)] = values
    return out
