"""Overlap of reported regions with the true regions of injected effects (intersection over union).

On each axis a true region contains the middle 90 % of the squared effect over noise variance. The overlap of
two regions of one channel is the product of intersection over union on pressure, contraction, time and
direction. Regions of different channels have no overlap.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pamjax.diagnosis.detect.locate import MisfitRegion
from pamjax.diagnosis.detect.recording_axes import LENGTHENING, SHORTENING, RecordingAxes
from pamjax.infer.problem.dataset import CHANNELS

#: Share of a squared effect outside a region at each end, and smallest share for a motion.
_TRUE_REGION_TAIL_SHARE, _MIN_TRUE_MOTION_SHARE = 0.05, 0.15
#: Smallest rms on a channel over the largest, for a region on that channel.
_MIN_TRUE_REGION_RMS_RATIO = 0.5
#: Intervals shorter than this share of the recorded range are widened to it, so that points can match.
_MIN_INTERVAL_SHARE = 0.02

_MOTION_SETS = {
    "shortening": {SHORTENING},
    "lengthening": {LENGTHENING},
    "both": {SHORTENING, LENGTHENING},
}
_REGION_AXES = ("pressure", "contraction", "time")


def compute_true_regions(axes: RecordingAxes, effects: np.ndarray, noise: np.ndarray) -> list[MisfitRegion]:
    """Return the true regions of effects.

    Args:
        axes: pressure, contraction, time and motion of every row.
        effects: (k, 2, n) effects, SI; NaN where not measured.
        noise: (2, n) standard deviation of a sample, SI.
    """
    regions = []
    for effect in effects:
        square = np.nan_to_num((effect / noise) ** 2)
        measured = [max(int(np.isfinite(channel_square).sum()), 1) for channel_square in effect]
        sizes = [
            float(np.sqrt(channel_square.sum() / sample_count))
            for channel_square, sample_count in zip(square, measured, strict=True)
        ]
        for c, size in enumerate(sizes):
            if size > 0 and size >= _MIN_TRUE_REGION_RMS_RATIO * max(sizes):
                regions.append(_build_true_region(axes, CHANNELS[c], square[c]))
    return regions


def _build_true_region(axes: RecordingAxes, channel: str, square: np.ndarray) -> MisfitRegion:
    spans = [_compute_middle_range(getattr(axes, axis), square) for axis in _REGION_AXES]
    moving = {way: float(square[axes.motion == way].sum()) for way in (SHORTENING, LENGTHENING)}
    motion, both = "both", sum(moving.values())
    if both >= 0.5 * square.sum():
        if moving[SHORTENING] < _MIN_TRUE_MOTION_SHARE * both:
            motion = "lengthening"
        elif moving[LENGTHENING] < _MIN_TRUE_MOTION_SHARE * both:
            motion = "shortening"
    return MisfitRegion(channel, motion, spans[0], spans[1], spans[2], 1.0, "")


def _compute_middle_range(values: np.ndarray, weights: np.ndarray) -> tuple[float, float]:
    order = np.argsort(values)
    share = np.cumsum(weights[order]) / weights.sum()
    low, high = (
        min(int(np.searchsorted(share, edge)), order.size - 1)
        for edge in (_TRUE_REGION_TAIL_SHARE, 1 - _TRUE_REGION_TAIL_SHARE)
    )
    return float(values[order][low]), float(values[order][high])


def compute_overlap(
    axes: RecordingAxes, claims: Sequence[MisfitRegion], regions: Sequence[MisfitRegion]
) -> float:
    """Return the largest overlap of any reported region with any true region."""
    domain = _compute_domain(axes)
    return max(
        (_compute_region_overlap(claim, region, domain) for claim in claims for region in regions),
        default=0.0,
    )


def compute_blind_overlap(axes: RecordingAxes, regions: Sequence[MisfitRegion]) -> float:
    """Return the overlap of a region over the whole recording, for comparison."""
    pressure, contraction, time = (span for span in _compute_domain(axes).values())
    whole_recording = [
        MisfitRegion(channel, "both", pressure, contraction, time, 1.0, "") for channel in CHANNELS
    ]
    return compute_overlap(axes, whole_recording, regions)


def _compute_domain(axes: RecordingAxes) -> dict[str, tuple[float, float]]:
    return {
        axis: (float(np.min(v)), float(np.max(v))) for axis in _REGION_AXES for v in (getattr(axes, axis),)
    }


def _compute_region_overlap(
    claim: MisfitRegion, other: MisfitRegion, domain: dict[str, tuple[float, float]]
) -> float:
    if claim.channel != other.channel:
        return 0.0
    shared_count, total_count = (
        len(f(_MOTION_SETS[claim.motion], _MOTION_SETS[other.motion])) for f in (set.__and__, set.__or__)
    )
    out = shared_count / total_count
    for axis, (low, high) in domain.items():
        out *= _compute_interval_overlap(
            getattr(claim, axis), getattr(other, axis), _MIN_INTERVAL_SHARE * (high - low)
        )
    return out


def _compute_interval_overlap(
    claim: tuple[float, float], other: tuple[float, float], min_length: float
) -> float:
    """Return intersection over union of two intervals, widened to `min_length`.

    >>> _compute_interval_overlap((0.0, 2.0), (1.0, 3.0), 0.01)
    0.3333333333333333
    >>> _compute_interval_overlap((1.0, 1.0), (1.0, 1.0), 0.01)
    1.0
    >>> _compute_interval_overlap((0.0, 1.0), (2.0, 3.0), 0.01)
    0.0
    """
    (a, b), (c, d) = _widen_interval(claim, min_length), _widen_interval(other, min_length)
    if b == a and d == c:
        return float(a == c)
    return max(min(b, d) - max(a, c), 0.0) / (max(b, d) - min(a, c))


def _widen_interval(interval: tuple[float, float], min_length: float) -> tuple[float, float]:
    low, high = interval
    extra = max(min_length - (high - low), 0.0) / 2
    return low - extra, high + extra
