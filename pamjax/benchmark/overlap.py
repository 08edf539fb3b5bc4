"""Overlap: where a concealed effect truly is, and how well a claim about that place matches.

A true box holds, on each axis, the middle 90 % of the squared effect in noise standard deviations. Two
boxes of one channel overlap by the product, over pressure, contraction, time and direction, of the length
they share over the length they cover together; of different channels not at all.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pamjax.diagnosis.detect.locate import Box
from pamjax.diagnosis.detect.regions import LENGTHENING, SHORTENING, Axes
from pamjax.infer.problem.dataset import CHANNELS

#: What of a squared effect lies outside a box at each end, and from which share a direction counts.
TAIL, SIDE = 0.05, 0.15
#: Rms on a channel, over the largest, from which an effect has a box there.
CHANNEL = 0.5
#: Intervals thinner than this share of what was recorded are widened to it: a point can match a point.
THIN = 0.02

WAYS = {"shortening": {SHORTENING}, "lengthening": {LENGTHENING}, "both": {SHORTENING, LENGTHENING}}
AXES = ("pressure", "contraction", "time")


def true_boxes(at: Axes, effects: np.ndarray, noise: np.ndarray) -> list[Box]:
    """Boxes of effects.

    Args:
        at: what the recording did, row by row.
        effects: (k, 2, n) SI, NaN where not measured.
        noise: (2, n) standard deviation of a sample, SI.
    """
    boxes = []
    for effect in effects:
        square = np.nan_to_num((effect / noise) ** 2)
        measured = [max(int(np.isfinite(one).sum()), 1) for one in effect]
        sizes = [float(np.sqrt(one.sum() / many)) for one, many in zip(square, measured, strict=True)]
        for c, size in enumerate(sizes):
            if size > 0 and size >= CHANNEL * max(sizes):
                boxes.append(_box(at, CHANNELS[c], square[c]))
    return boxes


def _box(at: Axes, channel: str, square: np.ndarray) -> Box:
    spans = [_middle(getattr(at, axis), square) for axis in AXES]
    moving = {way: float(square[at.direction == way].sum()) for way in (SHORTENING, LENGTHENING)}
    direction, both = "both", sum(moving.values())
    if both >= 0.5 * square.sum():
        if moving[SHORTENING] < SIDE * both:
            direction = "lengthening"
        elif moving[LENGTHENING] < SIDE * both:
            direction = "shortening"
    return Box(channel, direction, spans[0], spans[1], spans[2], 1.0, "")


def _middle(values: np.ndarray, weights: np.ndarray) -> tuple[float, float]:
    order = np.argsort(values)
    share = np.cumsum(weights[order]) / weights.sum()
    low, high = (min(int(np.searchsorted(share, edge)), order.size - 1) for edge in (TAIL, 1 - TAIL))
    return float(values[order][low]), float(values[order][high])


def overlap(at: Axes, claims: Sequence[Box], boxes: Sequence[Box]) -> float:
    """The best overlap of any claim with any true box."""
    domain = _domain(at)
    return max((_overlap(claim, box, domain) for claim in claims for box in boxes), default=0.0)


def blind(at: Axes, boxes: Sequence[Box]) -> float:
    """The overlap that a claim of the whole recording has, for comparison."""
    pressure, contraction, time = (span for span in _domain(at).values())
    whole = [Box(channel, "both", pressure, contraction, time, 1.0, "") for channel in CHANNELS]
    return overlap(at, whole, boxes)


def _domain(at: Axes) -> dict[str, tuple[float, float]]:
    return {axis: (float(np.min(v)), float(np.max(v))) for axis in AXES for v in (getattr(at, axis),)}


def _overlap(one: Box, other: Box, domain: dict[str, tuple[float, float]]) -> float:
    if one.channel != other.channel:
        return 0.0
    shared, together = (len(f(WAYS[one.direction], WAYS[other.direction])) for f in (set.__and__, set.__or__))
    out = shared / together
    for axis, (low, high) in domain.items():
        out *= interval_overlap(getattr(one, axis), getattr(other, axis), THIN * (high - low))
    return out


def interval_overlap(one: tuple[float, float], other: tuple[float, float], thin: float) -> float:
    """Length shared over length covered together, of intervals at least so thick.

    >>> interval_overlap((0.0, 2.0), (1.0, 3.0), 0.01)
    0.3333333333333333
    >>> interval_overlap((1.0, 1.0), (1.0, 1.0), 0.01)
    1.0
    >>> interval_overlap((0.0, 1.0), (2.0, 3.0), 0.01)
    0.0
    """
    (a, b), (c, d) = _thick(one, thin), _thick(other, thin)
    if b == a and d == c:
        return float(a == c)
    return max(min(b, d) - max(a, c), 0.0) / (max(b, d) - min(a, c))


def _thick(interval: tuple[float, float], thin: float) -> tuple[float, float]:
    low, high = interval
    more = max(thin - (high - low), 0.0) / 2
    return low - more, high + more
