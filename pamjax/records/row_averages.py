"""Averages of neighbouring rows: a shorter recording with nearly the same information.

A long recording has more samples in each stroke than a model needs. Each group of m neighbouring rows becomes
one row, the mean of its samples. White noise decreases by √m, so that the averages together are as accurate
as the samples.

A group does not extend over a turn, a pause or the end of a block. Some rows are not averaged: turns, and the
first rows of each stroke, where friction changes its sign. Where an input changes fast, groups are smaller.

Some sensors are read in every second or tenth row only. A group is centred on such a row where possible.
Elsewhere the mean is moved to the mean time of the group, with the slope between the neighbouring means.

Neglects: effects that are faster than the interval of the groups.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from pamjax.records.reading.muscle_toml import Sensors
from pamjax.records.reading_noise import estimate_reading_noise
from pamjax.records.recording import Recording
from pamjax.records.turns import find_turns

#: Largest change of pressure or of length in a group, as a share of its range in the recording. A recording
#: with too many rows at the first share has the next one.
_MAX_CHANGE_SHARES = (0.02, 0.05, 0.1, 0.3)

#: Largest number of groups, relative to the number of rows over the size of a group, below the last share.
_MAX_GROUP_RATIO = 2.0

#: Range within a group that noise explains, sd of the noise. The range of many samples is larger.
_MAX_NOISE_RANGE = 6.0

#: Rows of a part are not averaged until an input has changed by this share of its range: at least the first
#: number of rows, and at most the second.
_MIN_START_SHARE, _START_ROWS = 0.05, (5, 20)


@dataclass(frozen=True, eq=False)
class RowAverages:
    """Groups of neighbouring rows.

    Attributes:
        recording: the recording.
        part: (n,) number of the continuous part of each row: a stroke, a hold.
        is_turn: (n,) whether a row is a turn.
        group: (n,) number of the group of each row, from zero, increasing.
    """

    recording: Recording
    part: np.ndarray
    is_turn: np.ndarray
    group: np.ndarray

    @classmethod
    def from_recording(cls, recording: Recording, label: np.ndarray, size: int) -> RowAverages:
        """Return groups of at most a size.

        Args:
            recording: the recording, a time series.
            label: (n,) block of each row, -1 for none; no group has rows of two blocks.
            size: rows in a group, an odd number.
        """
        is_turn = find_turns(recording)
        part = _number_parts(recording, label, is_turn)
        # A turn and the first rows of a part are groups of their own.
        is_single = is_turn | _find_first_rows(recording, part)
        is_bound = is_single | (np.diff(part, prepend=-1) != 0)
        is_bound[1:] |= is_single[:-1] | (np.diff(label) != 0)
        starts = is_bound
        for share in _MAX_CHANGE_SHARES:
            starts = _start_groups(recording, is_bound, size, share)
            if starts.sum() <= _MAX_GROUP_RATIO * recording.n / size:
                break
        return cls(recording, part, is_turn, np.cumsum(starts) - 1)

    @cached_property
    def first_rows(self) -> np.ndarray:
        """Return the index of the first row of each group, (k,)."""
        return np.flatnonzero(np.diff(self.group, prepend=-1))

    @cached_property
    def centres(self) -> np.ndarray:
        """Return the index of the row in the centre of each group, (k,)."""
        return self.first_rows + (np.bincount(self.group) - 1) // 2

    @cached_property
    def mean_time(self) -> np.ndarray:
        """Return the mean time of each group, (k,) s."""
        assert self.recording.time is not None
        return self.sum(self.recording.time) / np.bincount(self.group)

    def sum(self, values: np.ndarray) -> np.ndarray:
        """Return the sum of values in each group, (k,)."""
        return np.bincount(self.group, weights=values)

    def average(self, values: np.ndarray) -> np.ndarray:
        """Return the means of the values that were measured, (k,); NaN in a group without one."""
        is_measured = np.isfinite(values)
        counts = self.sum(is_measured)
        with np.errstate(invalid="ignore"):
            # The mean of equal readings is that reading: differences from the first are exactly zero.
            reference = values[self.first_rows]
            reference = np.where(np.isfinite(reference), reference, 0.0)
            deviation = np.where(is_measured, values - reference[self.group], 0.0)
            mean = reference + self.sum(deviation) / np.where(counts > 0, counts, np.nan)
        is_partly_measured = counts < np.bincount(self.group)
        return np.where(is_partly_measured, self._move_to_mean_time(mean, is_measured), mean)

    def contains(self, mask: np.ndarray) -> np.ndarray:
        """Return whether a group has a row of a mask, (k,)."""
        return self.sum(mask) > 0

    @cached_property
    def averaged_recording(self) -> Recording:
        """Return the recording with one row for each group."""
        recording = self.recording
        # Pressure and length belong together: a row without one of them has no prediction.
        inputs = {
            name: self.average(np.where(recording.usable, getattr(recording, name), np.nan))
            for name in ("pressure", "length")
        }
        channels = {name: self.average(getattr(recording, name)) for name in ("force", "diameter")}
        averaged = replace(recording.select(self.centres), time=self.mean_time, **inputs, **channels)
        return averaged.mark_run_starts(recording.is_run_start[self.first_rows])

    def scale_sensors(self, sensors: Sensors) -> Sensors:
        """Return the noise of the means in a typical group, if the noise of the samples is white."""
        names = ["pressure", "force", "diameter", *([] if sensors.length_per_level else ["length"])]
        scaled = {}
        for name in names:
            sd = getattr(sensors, name)
            if sd is not None:
                scaled[name] = sd / math.sqrt(_find_typical_count(self.count(name)))
        return replace(sensors, **scaled)

    def compute_noise_ratios(self, name: str) -> np.ndarray:
        """Return the white noise of each mean of a channel relative to that in a typical group, (k,)."""
        counts = self.count(name)
        return np.sqrt(_find_typical_count(counts) / np.maximum(counts, 1))

    def count(self, name: str) -> np.ndarray:
        """Return the number of a channel's samples in each group, (k,)."""
        return self.sum(np.isfinite(getattr(self.recording, name)))

    def _move_to_mean_time(self, mean: np.ndarray, is_measured: np.ndarray) -> np.ndarray:
        """Return means, (k,), moved from the mean time of their samples to that of their group."""
        assert self.recording.time is not None
        counts, moved = self.sum(is_measured), mean.copy()
        groups = np.flatnonzero(counts)
        time = self.sum(np.where(is_measured, self.recording.time, 0.0))[groups] / counts[groups]
        part, here = self.part[self.centres[groups]], np.arange(groups.size)
        # The neighbours before and after a mean, or the mean itself at the end of a part.
        before, after = np.maximum(here - 1, 0), np.minimum(here + 1, groups.size - 1)
        before, after = (np.where(part[k] == part, k, here) for k in (before, after))
        interval, change = time[after] - time[before], mean[groups][after] - mean[groups][before]
        slope = np.divide(change, interval, out=np.zeros(groups.size), where=interval > 0)
        moved[groups] += slope * (self.mean_time[groups] - time)
        return moved


def _find_typical_count(counts: np.ndarray) -> float:
    """Return the median number of samples of the groups that have some, from (k,); 1 without samples."""
    return float(np.median(counts[counts > 0])) if counts.any() else 1.0


def _number_parts(recording: Recording, label: np.ndarray, is_turn: np.ndarray) -> np.ndarray:
    """Return the number of the continuous part of each row, (n,).

    A part ends at a pause, a turn, and where the cycle or the block changes. Rows without a block belong to
    the part before them.
    """
    is_first = recording.is_run_start.copy()
    is_first[1:] |= np.diff(recording.cycle) != 0
    labelled = np.flatnonzero(label >= 0)
    is_first[labelled[1:]] |= np.diff(label[labelled]) != 0
    # A turn between two samples is found at both: the first is the last of its stroke.
    is_first[1:] |= is_turn[:-1] & ~np.append(False, is_turn[:-2])
    is_first[:1] = True
    return np.cumsum(is_first) - 1


def _find_first_rows(recording: Recording, part: np.ndarray) -> np.ndarray:
    """Return whether a row is among the first of its part, before an input has changed, (n,) bool."""
    first_row = np.searchsorted(part, part)
    position, change = np.arange(part.size) - first_row, np.zeros(part.size)
    for values in (recording.pressure, recording.length):
        change = np.fmax(change, np.abs(values - values[first_row]) / (_compute_range(values) or 1.0))
    least, most = _START_ROWS
    return (position < least) | ((position < most) & (change < _MIN_START_SHARE))


def _start_groups(recording: Recording, is_bound: np.ndarray, size: int, share: float) -> np.ndarray:
    """Return whether a group starts at a row, (n,) bool.

    Args:
        recording: the recording.
        is_bound: (n,) whether a group must start at a row.
        size: largest number of rows in a group, an odd number.
        share: largest change of an input in a group, as a share of its range.
    """
    rarest = min(recording.channels, key=lambda name: np.isfinite(getattr(recording, name)).sum())
    is_read = np.isfinite(getattr(recording, rarest))
    starts, is_divided = is_bound, np.ones(recording.n, dtype=bool)
    while is_divided.any():
        bounds = np.append(np.flatnonzero(starts), recording.n)
        starts = np.concatenate(
            [
                _choose_starts(is_read[a:b], size) if is_divided[a] else starts[a:b]
                for a, b in pairwise(bounds)
            ]
        )
        # Smaller groups take the place of those in which an input changes too fast.
        is_divided = _find_fast_rows(recording, starts, share)
        size = (size // 2 - 1) | 1
    return starts


def _choose_starts(is_read: np.ndarray, size: int) -> np.ndarray:
    """Return whether a group starts at a row of a segment, (n,) bool.

    The centre of a group is a row in which the rarest channel was measured, where possible.

    Args:
        is_read: (n,) whether this channel was measured in a row of the segment.
        size: rows in a group, an odd number.
    """
    half_width = size // 2
    phases = range(min(size, is_read.size))
    phase = max(phases, key=lambda s: (np.mean(is_read[s::size]), -abs(s - half_width)))
    starts = np.zeros(is_read.size, dtype=bool)
    starts[(phase - half_width) % size :: size] = True
    # Less than half of a group at an end of the segment belongs to its neighbour.
    starts[: half_width + 1] = False
    starts[is_read.size - half_width :] = False
    starts[0] = True
    return starts


def _find_fast_rows(recording: Recording, starts: np.ndarray, share: float) -> np.ndarray:
    """Return whether an input changes too fast in the group of a row, (n,) bool."""
    group, first_rows = np.cumsum(starts) - 1, np.flatnonzero(starts)
    is_fast, counts = np.zeros(first_rows.size, dtype=bool), np.bincount(group)
    # The largest of m normal values is below √(2 ln m) on average, and rarely 1.5 above it.
    noise_range = np.maximum(_MAX_NOISE_RANGE, 2 * np.sqrt(2 * np.log(counts)) + 3)
    for values in (recording.pressure, recording.length):
        noise = estimate_reading_noise(np.diff(values, 2))
        limit = np.fmax(share * _compute_range(values), noise_range * noise)
        # The range, not the difference of the ends: a group can contain a smooth turn.
        is_fast |= np.fmax.reduceat(values, first_rows) - np.fmin.reduceat(values, first_rows) > limit
    return is_fast[group]


def _compute_range(values: np.ndarray) -> float:
    """Return the difference of the largest and the smallest measured value; 0 without one."""
    measured = values[np.isfinite(values)]
    return float(np.ptp(measured)) if measured.size else 0.0
