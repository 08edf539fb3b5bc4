"""Averages of neighbouring rows: a shorter recording with nearly the same information.

A long recording has more samples in each stroke than a model needs. Each group of m neighbouring rows becomes
one row, the mean of its samples. White noise decreases by √m, so that the averages together are as accurate
as the samples. A group does not extend over a turn, a pause or the end of a block. Some rows are not
averaged: those between which the inputs change fast, and the first of each stroke, where friction changes its
sign.

Some sensors are read in every second or tenth row only. Their mean must belong to the mean time of the group:

- A group has an odd number of rows, and is centred on such samples where possible.
- Elsewhere the samples are moved to the mean time of the group with the local slope of their channel.

Neglects: effects that are faster than the interval of the groups, and correlation of the noise.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np

from pamjax.records.reading.muscle_toml import Sensors
from pamjax.records.recording import Recording
from pamjax.records.turns import find_turns

#: Largest change of pressure or of length in a group, as a share of its range in the recording.
_MAX_CHANGE_SHARE = 0.02

#: Rows of a part are not averaged until an input has changed by this share of its range: at least the first
#: number of rows, and at most the second.
_MIN_START_SHARE, _START_ROWS = 0.05, (5, 20)


@dataclass(frozen=True, eq=False)
class RowAverages:
    """Groups of neighbouring rows.

    Attributes:
        recording: the recording.
        part: (n,) number of the continuous part of each row: a stroke, a hold.
        group: (n,) number of the group of each row, from zero, increasing.
    """

    recording: Recording
    part: np.ndarray
    group: np.ndarray

    @classmethod
    def from_recording(cls, recording: Recording, label: np.ndarray, size: int) -> RowAverages:
        """Return groups of a size.

        Args:
            recording: the recording, a time series.
            label: (n,) block of each row; no group has rows of two blocks.
            size: rows in a group, an odd number.
        """
        is_turn = find_turns(recording)
        is_first = recording.is_run_start.copy()
        is_first[1:] |= (np.diff(label) != 0) | (np.diff(recording.cycle) != 0)
        # A turn between two samples is found at both: the first is the last of its stroke.
        is_first[1:] |= is_turn[:-1] & ~np.append(False, is_turn[:-2])
        rarest = min(recording.channels, key=lambda name: np.isfinite(getattr(recording, name)).sum())
        is_read = np.isfinite(getattr(recording, rarest))
        bounds = np.append(np.flatnonzero(is_first), recording.n)
        starts = np.concatenate([_choose_starts(is_read[a:b], size) for a, b in pairwise(bounds)])
        # The speed at a turn is not known: that row is a group of its own.
        starts |= is_turn
        starts[1:] |= is_turn[:-1]
        part = np.cumsum(is_first) - 1
        starts |= _find_first_rows(recording, part)
        starts = _split_fast_groups(recording, starts)
        return cls(recording, part, np.cumsum(starts) - 1)

    @cached_property
    def centres(self) -> np.ndarray:
        """Return the index of the row in the centre of each group, (k,)."""
        first_rows = np.flatnonzero(np.diff(self.group, prepend=-1))
        return first_rows + (np.bincount(self.group) - 1) // 2

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
        is_partly_measured = (counts < np.bincount(self.group))[self.group]
        moved = np.where(is_measured & is_partly_measured, self._move_to_mean_time(values), values)
        with np.errstate(invalid="ignore"):
            return self.sum(np.where(is_measured, moved, 0.0)) / np.where(counts > 0, counts, np.nan)

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
        return replace(recording.select(self.centres), time=self.mean_time, **inputs, **channels)

    def scale_sensors(self, sensors: Sensors) -> Sensors:
        """Return the noise of the means in a typical group, of sensors with white noise."""
        names = ["pressure", "force", "diameter", *([] if sensors.length_per_level else ["length"])]
        return replace(
            sensors,
            **{
                name: sd * self._compute_noise_ratio(getattr(self.recording, name))
                for name in names
                if (sd := getattr(sensors, name)) is not None
            },
        )

    def compute_row_noise_ratios(self, values: np.ndarray) -> np.ndarray:
        """Return the noise of the mean in each group relative to a typical group, (k,); 1 without samples."""
        counts = self.sum(np.isfinite(values))
        return np.where(
            counts > 0, 1 / np.sqrt(np.maximum(counts, 1)) / self._compute_noise_ratio(values), 1.0
        )

    def _compute_noise_ratio(self, values: np.ndarray) -> float:
        """Return the median ratio of the noise of a mean and of a sample; 1 without samples."""
        counts = self.sum(np.isfinite(values))
        return float(1 / np.sqrt(np.median(counts[counts > 0]))) if counts.any() else 1.0

    def _move_to_mean_time(self, values: np.ndarray) -> np.ndarray:
        """Return the values at the mean time of their group, by the slope between their neighbours."""
        assert self.recording.time is not None
        rows = np.flatnonzero(np.isfinite(values))
        time, part, read = self.recording.time[rows], self.part[rows], values[rows]
        # The neighbours before and after a sample, or the sample itself at the end of a part.
        here = np.arange(rows.size)
        before, after = np.maximum(here - 1, 0), np.minimum(here + 1, rows.size - 1)
        before, after = (np.where(part[k] == part, k, here) for k in (before, after))
        interval = time[after] - time[before]
        slope = np.divide(read[after] - read[before], interval, out=np.zeros(rows.size), where=interval > 0)
        moved = values.copy()
        moved[rows] += slope * (self.mean_time[self.group[rows]] - time)
        return moved


def _choose_starts(is_read: np.ndarray, size: int) -> np.ndarray:
    """Return whether a group starts at a row of a part, (n,) bool.

    The centre of a group is a row in which the rarest channel was measured, where possible.

    Args:
        is_read: (n,) whether this channel was measured in a row of the part.
        size: rows in a group.
    """
    half_width = size // 2
    phases = range(min(size, is_read.size))
    phase = max(phases, key=lambda s: (np.mean(is_read[s::size]), -abs(s - half_width)))
    starts = np.zeros(is_read.size, dtype=bool)
    starts[(phase - half_width) % size :: size] = True
    # Less than half of a group at an end of the part belongs to its neighbour.
    starts[: half_width + 1] = False
    starts[is_read.size - half_width :] = False
    starts[0] = True
    return starts


def _find_first_rows(recording: Recording, part: np.ndarray) -> np.ndarray:
    """Return whether a row is among the first of its part, before an input has changed, (n,) bool."""
    first_row = np.searchsorted(part, part)
    position, change = np.arange(part.size) - first_row, np.zeros(part.size)
    for values in (recording.pressure, recording.length):
        value_range = np.ptp(values[np.isfinite(values)])
        change = np.fmax(change, np.abs(values - values[first_row]) / (value_range or 1.0))
    least, most = _START_ROWS
    return (position < least) | ((position < most) & (change < _MIN_START_SHARE))


def _split_fast_groups(recording: Recording, starts: np.ndarray) -> np.ndarray:
    """Return the starts of groups, (n,) bool; rows between which an input changes fast start their own."""
    group, first_rows = np.cumsum(starts) - 1, np.flatnonzero(starts)
    last_rows = np.append(first_rows[1:], starts.size) - 1
    is_fast = np.zeros(first_rows.size, dtype=bool)
    for values in (recording.pressure, recording.length):
        value_range = np.ptp(values[np.isfinite(values)])
        is_fast |= np.abs(values[last_rows] - values[first_rows]) > _MAX_CHANGE_SHARE * value_range
    return starts | is_fast[group]
