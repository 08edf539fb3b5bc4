"""Levels: the few values on which a channel settles, as isobars or the lengths that were set."""

from __future__ import annotations

import numpy as np

#: A channel that moves by less than this share of its size has been held all along.
MAX_CONSTANT_RANGE = 0.02
#: A channel settles if this share of its samples lies on levels; the rest are moves between them.
MIN_SHARE_ON_LEVELS = 0.75
#: Two sorted samples farther apart than this share of the range lie on two levels, if there are few samples.
MIN_LEVEL_GAP = 0.02
#: Few samples are counted one by one, many in this number of bins over the range.
MAX_UNBINNED_SAMPLES, BIN_COUNT = 400, 200
#: A bin this many times fuller than if the samples were spread evenly belongs to a level.
MIN_BIN_FILL_RATIO = 2.0
#: A level is no wider than this share of the range, or it is a stroke ...
MAX_LEVEL_WIDTH = 0.08
#: ... and no wider than this share of the distance to the next one.
MAX_WIDTH_TO_SPACING = 0.25
#: A level holds at least this share of the samples, and three of them on average.
MIN_LEVEL_SHARE = 0.01
#: In a history a channel stays: this share of samples has the one before it on the same level. A stroke
#: that is sampled at the same lengths each time has few values too, but stays on none.
MIN_STAY_SHARE = 0.5


def find_levels(channel: np.ndarray, ordered: bool = False) -> np.ndarray:
    """Centres of the values on which a channel settles, ascending; empty if it does not settle.

    Args:
        channel: (n,) SI, NaN where not measured.
        ordered: whether the rows are a history, in which a level is a place to stay.

    >>> find_levels(np.repeat([1.0, 3.0, 2.0], 50))
    array([1., 2., 3.])
    >>> find_levels(np.linspace(0.0, 1.0, 200))
    array([], dtype=float64)
    """
    history = channel[np.isfinite(channel)]
    x = np.sort(history)
    if not len(x):
        return np.empty(0)
    if x[-1] - x[0] <= MAX_CONSTANT_RANGE * np.max(np.abs(x)):
        return np.array([np.median(x)])
    groups = _split_by_gaps(x) if len(x) < MAX_UNBINNED_SAMPLES else _group_by_bins(x)
    groups = [group for group in groups if len(group) >= max(2, MIN_LEVEL_SHARE * len(x))]
    on_level = sum(len(group) for group in groups)
    if on_level < max(MIN_SHARE_ON_LEVELS * len(x), 3 * len(groups)):
        return np.empty(0)
    centres = np.array([np.median(group) for group in groups])
    # The middle 90 %: a sample or two on the way to the next level must not widen a level.
    widths = [float(np.ptp(np.quantile(group, [0.05, 0.95]))) for group in groups]
    apart = min(MAX_WIDTH_TO_SPACING * np.diff(centres).min(initial=np.inf), MAX_LEVEL_WIDTH * (x[-1] - x[0]))
    if max(widths) > apart or (ordered and not _stays_on_levels(history, centres)):
        return np.empty(0)
    return centres


def assign_levels(channel: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """(n,) index of the level each sample lies on; -1 between levels and where not measured."""
    nearest = find_nearest_level(channel, levels)
    if len(levels) < 2:
        return nearest
    far = np.abs(channel - levels[nearest]) > MAX_WIDTH_TO_SPACING * np.diff(levels).min()
    return np.where(far, -1, nearest)


def find_nearest_level(channel: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """(n,) index of the nearest level; -1 where not measured, or where there is no level."""
    measured = np.isfinite(channel)
    if not len(levels):
        return np.full(len(channel), -1)
    x = np.where(measured, channel, 0.0)
    return np.where(measured, np.abs(x[:, None] - levels).argmin(axis=1), -1)


def _stays_on_levels(history: np.ndarray, levels: np.ndarray) -> bool:
    label = assign_levels(history, levels)
    return float(np.mean((label[1:] >= 0) & (label[1:] == label[:-1]))) >= MIN_STAY_SHARE


def _split_by_gaps(x: np.ndarray) -> list[np.ndarray]:
    return np.split(x, np.flatnonzero(np.diff(x) > MIN_LEVEL_GAP * (x[-1] - x[0])) + 1)


def _group_by_bins(x: np.ndarray) -> list[np.ndarray]:
    """Samples in and right beside each stretch of full bins."""
    bins = np.minimum(((x - x[0]) / (x[-1] - x[0]) * BIN_COUNT).astype(int), BIN_COUNT - 1)
    full = np.bincount(bins, minlength=BIN_COUNT) > MIN_BIN_FILL_RATIO * len(x) / BIN_COUNT
    # One thin bin amid a level does not part it.
    full[1:-1] |= full[:-2] & full[2:]
    edges = np.flatnonzero(np.diff(np.r_[0, full.astype(int), 0]))
    return [x[(bins >= a - 1) & (bins <= b)] for a, b in zip(edges[::2], edges[1::2], strict=True)]
