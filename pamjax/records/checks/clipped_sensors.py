"""Detection of clipped sensors: readings that repeat the end of the sensor's range to the last digit.

A clipped channel has long sequences of its largest or smallest value, and no such sequences of other values.
A channel that is held, such as a regulated pressure, also repeats a value if it has no noise. So the other
readings must have noise above their last digit, or the muscle must move while force or diameter is constant.

Neglects: clipped readings in fewer than five successive rows, and a clipped zero.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from pamjax.channels import DISPLAY_UNIT
from pamjax.records.reading_noise import estimate_reading_noise
from pamjax.records.recording import Recording
from pamjax.units import format_count, format_quantity

#: Smallest length of a clipped sequence: rows, and ratio to the longest sequence of another value.
_MIN_CLIPPED_ROWS, _MIN_CLIPPED_RATIO = 5, 4
#: Smallest size of a clipped value, as a share of the largest one: a slack muscle repeats its zero.
_MIN_VALUE_SHARE = 0.1
#: Smallest share of rows with other values.
_MIN_OTHER_SHARE = 0.5
#: Smallest change of pressure or length in a clipped sequence, as a share of its range and of its maximum.
_MIN_DRIVER_RANGE_SHARE, _MIN_DRIVER_VALUE_SHARE = 0.05, 0.01
#: Smallest share of sign changes between successive second differences: white noise has 0.73, and a smooth
#: channel close to 0.
_MIN_SIGN_CHANGES = 0.6
#: Smallest number of second differences from which the noise is estimated.
_MIN_SECOND_DIFFERENCES = 20


def find_clipped_sensors(recording: Recording, file: str, skipped: Collection[str] = ()) -> list[str]:
    """Return one warning for each channel whose readings end at a limit.

    Args:
        recording: the recording, SI.
        file: name of the CSV file.
        skipped: channels that are not checked.
    """
    sentences = []
    for name in ("force", "pressure", "diameter", "length"):
        values = getattr(recording, name)
        is_set = name == "force" and recording.measures_length
        if is_set or name in skipped or not np.isfinite(values).any():
            continue
        for word, limit in (("largest", np.nanmax(values)), ("smallest", np.nanmin(values))):
            rows = _find_clipped_run(recording, name, float(limit))
            if rows.size:
                reading = format_quantity(float(limit), DISPLAY_UNIT[name])
                count = format_count(int(np.sum(values == limit)), "row")
                place = f"rows {recording.row[rows[0]]} to {recording.row[rows[-1]]}"
                sentences.append(
                    f"`{name}` is exactly its {word} value, {reading}, in {count} of {file}; the longest"
                    f" sequence is {place}. If the sensor was at the end of its range, clear these cells."
                )
    return sentences


def _find_clipped_run(recording: Recording, name: str, limit: float) -> np.ndarray:
    """Return the rows of the longest clipped sequence of a channel; none if it is not clipped."""
    channel, none = getattr(recording, name), np.array([], dtype=int)
    rows = np.flatnonzero(np.isfinite(channel))
    values, part = channel[rows], np.cumsum(recording.is_run_start)[rows]
    min_size = _MIN_VALUE_SHARE * float(np.max(np.abs(values)))
    if abs(limit) < min_size or np.mean(values != limit) < _MIN_OTHER_SHARE:
        return none
    starts = np.flatnonzero(np.r_[True, (np.diff(values) != 0) | (np.diff(part) != 0)])
    lengths = np.diff(np.r_[starts, values.size])
    at_limit = values[starts] == limit
    k = int(np.argmax(np.where(at_limit, lengths, 0)))
    # A slack muscle also repeats its zero, which is no reading to compare with.
    is_compared = ~at_limit & (np.abs(values[starts]) >= min_size)
    longest_other = int(np.max(lengths[is_compared], initial=1))
    if lengths[k] < max(_MIN_CLIPPED_ROWS, _MIN_CLIPPED_RATIO * longest_other):
        return none
    clipped_rows = rows[starts[k] : starts[k] + lengths[k]]
    drivers = {"force": ("pressure", "length"), "diameter": ("length",)}.get(name, ())
    is_moving = any(_is_moving(getattr(recording, driver), clipped_rows) for driver in drivers)
    return clipped_rows if is_moving or _has_noise(values, part, limit) else none


def _is_moving(channel: np.ndarray, rows: np.ndarray) -> bool:
    """Return whether the medians of three parts of a sequence differ; its noise hardly changes them."""
    medians = [float(np.median(part)) for part in np.array_split(channel[rows], 3)]
    min_change = max(
        _MIN_DRIVER_RANGE_SHARE * float(np.nanmax(channel) - np.nanmin(channel)),
        _MIN_DRIVER_VALUE_SHARE * float(np.nanmax(channel)),
    )
    return max(medians) - min(medians) > min_change


def _has_noise(values: np.ndarray, part: np.ndarray, limit: float) -> bool:
    """Return whether the readings away from a limit have white noise with an sd above their last digit.

    Args:
        values: (n,) the readings.
        part: (n,) number of the continuous part of the recording.
        limit: the limit.
    """
    second_differences = np.diff(values, 2)
    is_used = (
        (values != limit)[:-2] & (values != limit)[1:-1] & (values != limit)[2:] & (part[2:] == part[:-2])
    )
    if is_used.sum() < _MIN_SECOND_DIFFERENCES:
        return False
    sd = estimate_reading_noise(second_differences[is_used])
    steps = np.diff(np.unique(values))
    # The conversion to SI makes different numbers of equal readings.
    last_digit = float(np.min(steps[steps > 1e-9 * np.max(np.abs(values))], initial=np.inf))
    is_pair = is_used[:-1] & is_used[1:]
    sign_changes = second_differences[:-1] * second_differences[1:] < 0
    return sd > last_digit and bool(np.mean(sign_changes[is_pair]) > _MIN_SIGN_CHANGES)
