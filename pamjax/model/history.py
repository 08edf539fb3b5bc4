"""Time and order of the samples, for mechanisms with memory.

A recording is a sequence of samples with gaps where the rig was moved. Memory continues across a gap, unless
a restart is stated. A rate is never computed across a gap. Before the first sample the muscle is assumed to
rest in the state of that sample. If stated, it has performed the same recording once instead.

Neglects: corners of strokes with five samples or fewer, across which the rate is computed.
"""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from pamjax.parameter import Scalar

#: Residual of a straight line, over its median, above which a signal has a corner.
_CORNER_RATIO = 6.0
#: Share of a channel's range below which differences are rounding, not noise.
_ROUNDING_SHARE = 1e-6
#: Share of a channel's range below which an isolated step is the resolution of the channel.
_RESOLUTION_SHARE = 0.02
#: Residual of a straight line, over its median, above which one side of a sample is curved.
_BEND_RATIO = 3.0

#: A rate is the slope of a straight line through a sample and this many neighbours on each side.
RATE_HALF_WIDTH = 2


class History(eqx.Module):
    """Time and order of the samples.

    Attributes:
        time: (n,) s; zeros for a static map.
        step: (n,) time since the previous sample, s; zero at the first.
        restart: (n,) whether memory restarts at this sample.
        rate_weights: (n, 2 RATE_HALF_WIDTH + 1) weights of a sample and its neighbours in the rate, 1/s;
            zero for neighbours in another run.
        first: (n,) first sample of each sample's run; the sample itself in a static map.
        last: (n,) last sample of each sample's run; the sample itself in a static map.
        settled: whether the muscle performed the same recording once before.
        row_count: number of samples to compute; later ones repeat the last. None for all; only None has
            derivatives in reverse mode.
    """

    time: Float[Array, " n"]
    step: Float[Array, " n"]
    restart: Bool[Array, " n"]
    rate_weights: Float[Array, "n k"]
    first: Int[Array, " n"]
    last: Int[Array, " n"]
    settled: bool = eqx.field(static=True, default=False)
    row_count: Int[Array, ""] | None = None

    def rate(self, values: Float[Array, " n"]) -> Float[Array, " n"]:
        """Return the rate of change of a quantity, 1/s; zero in a static map."""
        n, padded_values = values.shape[0], _compute_once(jnp.pad(values, RATE_HALF_WIDTH))
        return sum(
            (self.rate_weights[:, k] * padded_values[k : k + n] for k in range(2 * RATE_HALF_WIDTH + 1)),
            jnp.zeros(n),
        )

    def delay(self, values: Float[Array, " n"], lag: Scalar) -> Float[Array, " n"]:
        """Return a quantity `lag` seconds earlier; beyond the ends of a run, the value at that end.

        Between samples it is a cubic with the rates at both samples. The derivative by the lag is thus
        continuous, and minus the rate at a lag of zero.
        """
        delayed_time = self.time - lag
        before = jnp.searchsorted(self.time, delayed_time, side="right") - 1
        before = jnp.clip(before, self.first, jnp.maximum(self.last - 1, self.first))
        after = jnp.minimum(before + 1, self.last)
        span = self.time[after] - self.time[before]
        share = jnp.where(span > 0, (delayed_time - self.time[before]) / jnp.where(span > 0, span, 1.0), 0.0)
        x = jnp.clip(share, 0.0, 1.0)
        y, rate = _compute_once(values), _compute_once(self.rate(values))
        # Cubic Hermite interpolation.
        weight = x * x * (3 - 2 * x)
        slope_term = x * (1 - x) * span * ((1 - x) * rate[before] - x * rate[after])
        return (1 - weight) * y[before] + weight * y[after] + slope_term

    def increments(self, values: Float[Array, " n"]) -> Float[Array, " n"]:
        """Return the change of a quantity since the previous sample; zero where memory restarts."""
        before = jnp.concatenate([values[:1], values[:-1]])
        return jnp.where(self.restart, 0.0, values - before)

    def repeat(self) -> History:
        """Return the history of the recording played twice, 2n samples.

        The muscle moves from its last state to its first in one step, since the path between is unknown.
        Each sample of a static map still restarts.
        """
        n = self.time.shape[0]

        def join(early, late):
            return jnp.concatenate([early, late])

        is_static = jnp.all(self.restart)
        return History(
            time=join(self.time - (self.time[-1] - self.time[0]), self.time),
            step=join(self.step, self.step),
            restart=join(self.restart, self.restart.at[0].set(is_static)),
            rate_weights=join(self.rate_weights, self.rate_weights),
            first=join(self.first, self.first + n),
            last=join(self.last, self.last + n),
        )


def build_time_history(
    time: np.ndarray | None,
    is_run_start: np.ndarray,
    *,
    restart: bool = False,
    settled: bool = False,
    stroke_channels: np.ndarray | None = None,
    part: np.ndarray | None = None,
    size: int | None = None,
    compute_padding: bool = True,
) -> History:
    """Return the history of a recording.

    Args:
        time: (n,) s, increasing; None for a static map, which has no memory.
        is_run_start: (n,) whether a continuous run begins at this sample.
        restart: whether memory restarts at every run, rather than only at the first sample.
        settled: whether the muscle performed the same recording once before.
        stroke_channels: (k, n) channels that may have strokes, in any unit. No rate is computed across
            their corners.
        part: (n,) number of the known part of each sample, such as a stroke. No rate is computed across the
            ends of a part.
        size: length to pad to; padded samples repeat the last one.
        compute_padding: whether padded samples are computed; otherwise they repeat the last result.
    """
    n = is_run_start.size
    size = size or n
    clock = np.zeros(n) if time is None else np.asarray(time, dtype=float)
    run_number = np.cumsum(is_run_start)
    part_number = run_number if part is None else np.cumsum(is_run_start | np.diff(part, prepend=part[:1]))
    begin, end = (np.searchsorted(run_number, run_number, side=side) for side in ("left", "right"))
    row = np.arange(n)
    first = np.zeros(n, dtype=bool)
    first[:1] = True
    restarts = np.ones(n, dtype=bool) if time is None else (is_run_start | first if restart else first)
    return History(
        time=jnp.asarray(_pad_rows(clock, size, clock[-1] if n else 0.0)),
        step=jnp.asarray(_pad_rows(np.diff(clock, prepend=clock[:1]), size, 0.0)),
        restart=jnp.asarray(_pad_rows(restarts, size, time is None)),
        rate_weights=jnp.asarray(
            _pad_rows(_compute_rate_weights(clock, part_number, stroke_channels), size, 0.0)
        ),
        first=jnp.asarray(_pad_rows(row if time is None else begin, size, max(n - 1, 0))),
        last=jnp.asarray(_pad_rows(row if time is None else end - 1, size, max(n - 1, 0))),
        settled=settled,
        row_count=None if compute_padding else jnp.asarray(n),
    )


def _compute_once(values: Array) -> Array:
    """Return the same values, computed before indexing: otherwise each index computes them again."""
    return jax.lax.optimization_barrier(values)


def _compute_rate_weights(
    clock: np.ndarray, run_number: np.ndarray, stroke_channels: np.ndarray | None = None
) -> np.ndarray:
    """Return the weights of the least-squares slope of a sample and its neighbours in the same run.

    Next to a corner of a stroke, only neighbours on the sample's side of the corner count.
    """
    n = clock.size
    neighbours = np.clip(
        np.arange(n)[:, None] + np.arange(-RATE_HALF_WIDTH, RATE_HALF_WIDTH + 1), 0, max(n - 1, 0)
    )
    same_run = (run_number[neighbours] == run_number[:, None]) & (
        neighbours == np.arange(n)[:, None] + np.arange(-RATE_HALF_WIDTH, RATE_HALF_WIDTH + 1)
    )
    two_sided = _slope_weights(clock, neighbours, same_run)
    if stroke_channels is None or n <= 2 * RATE_HALF_WIDTH:
        return two_sided
    sides = [
        same_run & reach
        for reach in (
            np.arange(-RATE_HALF_WIDTH, RATE_HALF_WIDTH + 1) <= 0,
            np.arange(-RATE_HALF_WIDTH, RATE_HALF_WIDTH + 1) >= 0,
        )
    ]
    lines = [two_sided, *(_slope_weights(clock, neighbours, side) for side in sides)]
    misfit = _compute_line_misfit(
        clock, stroke_channels, neighbours, list(zip(lines, (same_run, *sides), strict=True))
    )
    # At a corner the residual of a line exceeds the noise. The sample belongs to its straight side, and the
    # other side is curved. A sample at the corner itself belongs to neither side, because the motion stops.
    side = 1 + np.argmin(misfit[1:], axis=0)
    straight_misfit, curved_misfit = misfit[1:].min(axis=0), misfit[1:].max(axis=0)
    corner = (
        (misfit[0] > _CORNER_RATIO)
        & (straight_misfit < misfit[0] / 2)
        & (curved_misfit > np.maximum(_BEND_RATIO, 2 * straight_misfit))
    )
    return np.where(corner[:, None], np.where((side == 1)[:, None], lines[1], lines[2]), two_sided)


def _compute_line_misfit(clock, stroke_channels, neighbours, lines) -> np.ndarray:
    """Return the residuals of straight lines, (lines, n), scaled so that the median of the first is one.

    Each channel is divided by its noise, or by its resolution.
    """
    total = np.zeros((len(lines), clock.size))
    for channel in stroke_channels:
        span = float(np.ptp(channel))
        if span > 0:
            neighbour_values = [np.where(in_line, channel[neighbours], 0.0) for _, in_line in lines]
            misfit = np.stack(
                [
                    _line_residual_rms(clock, a, neighbours, *line)
                    for a, line in zip(neighbour_values, lines, strict=True)
                ]
            )
            total += (
                misfit / max(_finite_median(misfit[0]), _ROUNDING_SHARE * span, _estimate_resolution(channel))
            ) ** 2
    misfit = np.sqrt(total)
    return misfit / max(_finite_median(misfit[0]), 1.0)


def _estimate_resolution(channel: np.ndarray) -> float:
    """Return the resolution of a slow channel, from its isolated steps; 0 without such steps."""
    step = np.abs(np.diff(channel))
    is_isolated = (
        (step[1:-1] > 0)
        & (step[:-2] == 0)
        & (step[2:] == 0)
        & (step[1:-1] < _RESOLUTION_SHARE * np.ptp(channel))
    )
    return float(np.median(step[1:-1][is_isolated])) if is_isolated.any() else 0.0


def _finite_median(misfit: np.ndarray) -> float:
    finite = misfit[np.isfinite(misfit)]
    return float(np.median(finite)) if finite.size else 0.0


def _line_residual_rms(clock, neighbour_values, neighbours, weights, in_line) -> np.ndarray:
    """Return the rms residual of a straight line, (n,); infinite where the line has two points only."""
    count = in_line.sum(axis=1)
    safe_count = np.maximum(count, 1)[:, None]
    neighbour_times = np.where(in_line, clock[neighbours], 0.0)
    values = np.where(
        in_line,
        neighbour_values - neighbour_values.sum(axis=1, keepdims=True, where=in_line) / safe_count,
        0.0,
    )
    rate = (weights * neighbour_values).sum(axis=1, keepdims=True)
    residual = values - rate * np.where(
        in_line, neighbour_times - neighbour_times.sum(axis=1, keepdims=True) / safe_count, 0.0
    )
    rms = np.sqrt((residual**2).sum(axis=1) / np.maximum(count - 2, 1))
    return np.where(count > 2, rms, np.inf)


def _slope_weights(clock: np.ndarray, neighbours: np.ndarray, same_run: np.ndarray) -> np.ndarray:
    count = same_run.sum(axis=1, keepdims=True)
    centred_time = np.where(same_run, clock[neighbours], 0.0)
    centred_time = np.where(
        same_run, centred_time - centred_time.sum(axis=1, keepdims=True) / np.maximum(count, 1), 0.0
    )
    sum_of_squares = (centred_time**2).sum(axis=1, keepdims=True)
    return np.where(sum_of_squares > 0, centred_time / np.where(sum_of_squares > 0, sum_of_squares, 1.0), 0.0)


def _pad_rows(values: np.ndarray, size: int, fill) -> np.ndarray:
    out = np.full((size, *values.shape[1:]), fill, dtype=values.dtype)
    out[: len(values)] = values
    return out
