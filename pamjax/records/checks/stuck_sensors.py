"""Detection of stuck sensors: constant readings while the muscle moves.

Causes are a load cell at the end of its range, a loose cable, or a dead weight written instead of a
measurement. The reading is then constant to the last digit.
"""

from __future__ import annotations

import numpy as np

from pamjax.channels import DISPLAY_UNIT
from pamjax.records.recording import Recording
from pamjax.units import format_quantity

#: Minimum length of a sequence of equal readings of a stuck sensor: rows, and share of all measured rows.
_MIN_STUCK_ROWS, _MIN_STUCK_SHARE = 20, 0.1
#: Minimum change of pressure or length if the muscle moves, as a share of its range and of its maximum.
_MIN_MOVED_RANGE_SHARE, _MIN_MOVED_VALUE_SHARE = 0.2, 0.01


def find_stuck_sensors(recording: Recording, file: str) -> list[str]:
    """Return one warning for each of force and diameter that is constant while the muscle moves.

    Force depends on pressure and length. Diameter depends on length; the effect of pressure may be below its
    last digit.

    Args:
        recording: the recording, SI. A force of 0 is that of a slack muscle and is not checked.
        file: name of the CSV file.
    """
    sentences = []
    drivers_by_channel = {
        "force": (recording.pressure, recording.length),
        "diameter": (recording.length,),
    }
    for name, drivers in drivers_by_channel.items():
        if name not in recording.channels:
            continue
        values = getattr(recording, name)
        first, last = _find_longest_run(recording, values)
        min_rows = max(_MIN_STUCK_ROWS, _MIN_STUCK_SHARE * np.isfinite(values).sum())
        if last - first >= min_rows and any(_is_moving(channel, first, last) for channel in drivers):
            reading = format_quantity(values[first], DISPLAY_UNIT[name])
            rows = f"rows {recording.row[first]} to {recording.row[last - 1]} of {file}"
            sentences.append(
                f"`{name}` is constant at {reading} in {rows}, while the muscle moves."
                " If its sensor was stuck, at its limit or not read, clear these cells."
            )
    return sentences


def _find_longest_run(recording: Recording, values: np.ndarray) -> tuple[int, int]:
    """Return first row and end of the longest sequence of equal readings in a continuous part."""
    is_checked = np.isfinite(values) & (values != 0)
    is_new = np.r_[True, values[1:] != values[:-1]] | ~is_checked | recording.is_run_start
    bounds = np.r_[np.flatnonzero(is_new), values.size]
    lengths = np.where(is_checked[bounds[:-1]], np.diff(bounds), 0)
    k = int(np.argmax(lengths))
    return int(bounds[k]), int(bounds[k] + lengths[k])


def _is_moving(channel: np.ndarray, first: int, last: int) -> bool:
    min_change = max(
        _MIN_MOVED_RANGE_SHARE * _compute_range(channel), _MIN_MOVED_VALUE_SHARE * float(np.nanmax(channel))
    )
    return _compute_range(channel[first:last]) > min_change


def _compute_range(values: np.ndarray) -> float:
    measured = values[np.isfinite(values)]
    return float(np.ptp(measured)) if measured.size else 0.0
