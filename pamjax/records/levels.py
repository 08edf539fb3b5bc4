"""Levels: the few values at which a channel is held, such as isobars or length settings."""

from __future__ import annotations

import numpy as np

#: A channel whose range is below this share of its magnitude is constant.
_MAX_CONSTANT_RANGE = 0.02
#: Minimum share of samples at levels; the others are transitions.
_MIN_SHARE_ON_LEVELS = 0.75
#: If there are few samples, a gap in the sorted values above this share of the range separates two levels.
_MIN_LEVEL_GAP = 0.02
#: Fewer samples than this are separated by gaps; more are counted in this number of bins over the range.
_MAX_UNBINNED_SAMPLES, _BIN_COUNT = 400, 200
#: A bin with this many times the count of a uniform distribution belongs to a level.
_MIN_BIN_FILL_RATIO = 2.0
#: Maximum width of a level, as a share of the range; a stroke is wider.
_MAX_LEVEL_WIDTH = 0.08
#: Maximum width of a level, as a share of the smallest distance between levels.
_MAX_WIDTH_TO_SPACING = 0.25
#: Minimum share of the samples at a level. The mean count per level is at least three.
_MIN_LEVEL_SHARE = 0.01
#: Minimum share of samples of a time series whose previous sample is at the same level. A stroke that is
#: sampled at the same lengths each time also has few values, but does not remain at any of them.
_MIN_STAY_SHARE = 0.5


def find_levels(channel: np.ndarray, is_time_series: bool = False) -> np.ndarray:
    """Return the levels of a channel, ascending, SI; empty if it has none.

    Args:
        channel: (n,) SI, NaN where not measured.
        is_time_series: whether the rows are a time series, so that a level must last several samples.

    >>> find_levels(np.repeat([1.0, 3.0, 2.0], 50))
    array([1., 2., 3.])
    >>> find_levels(np.linspace(0.0, 1.0, 200))
    array([], dtype=float64)
    """
    measured_values = channel[np.isfinite(channel)]
    x = np.sort(measured_values)
    if not len(x):
        return np.empty(0)
    if x[-1] - x[0] <= _MAX_CONSTANT_RANGE * np.max(np.abs(x)):
        return np.array([np.median(x)])
    groups = _split_by_gaps(x) if len(x) < _MAX_UNBINNED_SAMPLES else _group_by_bins(x)
    groups = [group for group in groups if len(group) >= max(2, _MIN_LEVEL_SHARE * len(x))]
    on_level = sum(len(group) for group in groups)
    if on_level < max(_MIN_SHARE_ON_LEVELS * len(x), 3 * len(groups)):
        return np.empty(0)
    centres = np.array([np.median(group) for group in groups])
    # Only the middle 90 %: single samples of a transition must not widen a level.
    widths = [float(np.ptp(np.quantile(group, [0.05, 0.95]))) for group in groups]
    max_width = min(
        _MAX_WIDTH_TO_SPACING * np.diff(centres).min(initial=np.inf), _MAX_LEVEL_WIDTH * (x[-1] - x[0])
    )
    if max(widths) > max_width or (is_time_series and not _stays_on_levels(measured_values, centres)):
        return np.empty(0)
    return centres


def assign_levels(channel: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """Return the index of each sample's level, (n,); -1 between levels and where not measured."""
    nearest = find_nearest_level(channel, levels)
    if len(levels) < 2:
        return nearest
    is_transition = np.abs(channel - levels[nearest]) > _MAX_WIDTH_TO_SPACING * np.diff(levels).min()
    return np.where(is_transition, -1, nearest)


def find_nearest_level(channel: np.ndarray, levels: np.ndarray) -> np.ndarray:
    """Return the index of the nearest level, (n,); -1 where not measured or if there is no level.

    Args:
        channel: (n,) SI, NaN where not measured.
        levels: the levels, ascending, SI.
    """
    measured = np.isfinite(channel)
    if not len(levels):
        return np.full(len(channel), -1)
    x = np.where(measured, channel, levels[0])
    # The middle between two levels belongs to the lower one.
    nearest = np.searchsorted((levels[1:] + levels[:-1]) / 2, x)
    return np.where(measured, nearest, -1)


def _stays_on_levels(measured_values: np.ndarray, levels: np.ndarray) -> bool:
    label = assign_levels(measured_values, levels)
    return float(np.mean((label[1:] >= 0) & (label[1:] == label[:-1]))) >= _MIN_STAY_SHARE


def _split_by_gaps(x: np.ndarray) -> list[np.ndarray]:
    return np.split(x, np.flatnonzero(np.diff(x) > _MIN_LEVEL_GAP * (x[-1] - x[0])) + 1)


def _group_by_bins(x: np.ndarray) -> list[np.ndarray]:
    """Return the samples in each sequence of full bins and in the bins next to it."""
    bins = np.minimum(((x - x[0]) / (x[-1] - x[0]) * _BIN_COUNT).astype(int), _BIN_COUNT - 1)
    full = np.bincount(bins, minlength=_BIN_COUNT) > _MIN_BIN_FILL_RATIO * len(x) / _BIN_COUNT
    # One bin with a low count inside a level does not divide the level.
    full[1:-1] |= full[:-2] & full[2:]
    edges = np.flatnonzero(np.diff(np.r_[0, full.astype(int), 0]))
    return [x[(bins >= a - 1) & (bins <= b)] for a, b in zip(edges[::2], edges[1::2], strict=True)]
