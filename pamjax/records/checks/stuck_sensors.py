"""Detection of stuck sensors: constant readings while the muscle moves.

Causes are a load cell at the end of its range, a loose cable, or a dead weight written instead of a
measurement. The reading is then constant to the last digit.
"""

from __future__ import annotations

import numpy as np

from pamjax.channels import DISPLAY_UNIT
from pamjax.records.recording import Recording
from pamjax.units import format_quantity

#: Readings alike one after another, rows and share of all of them, from which on a channel stands still.
MIN_STUCK_ROWS, MIN_STUCK_SHARE = 20, 0.1
#: Shares of its range, and of its largest value, through which pressure or length goes if the muscle moves.
MIN_MOVED_RANGE_SHARE, MIN_MOVED_VALUE_SHARE = 0.2, 0.01


def find_stuck_sensors(recording: Recording, file: str) -> list[str]:
    """Return one warning for each of force and diameter that is constant while the muscle moves.

    Force depends on pressure and length. Diameter depends on length; the effect of pressure may be below its
    last digit.

    Args:
        recording: the recording, SI. A force of 0 is that of a slack muscle and is not checked.
        file: name of the CSV file.
    """
    sentences = []
    moved_by = {
        "force": (recording.pressure, recording.length),
        "diameter": (recording.length,),
    }
    for name, movers in moved_by.items():
        if name not in recording.channels:
            continue
        values = getattr(recording, name)
        first, last = _find_longest_run(recording, values)
        enough = max(MIN_STUCK_ROWS, MIN_STUCK_SHARE * np.isfinite(values).sum())
        if last - first >= enough and any(_is_moving(channel, first, last) for channel in movers):
            rows = f"rows {recording.row[first]} to {recording.row[last - 1]}"
            sentences.append(
                f"`{name}` reads {format_quantity(values[first], DISPLAY_UNIT[name])} in {rows} of"
                f" {file}, while the"
                " muscle is moved. Blank it there if its sensor was stuck, at its limit, or not read."
            )
    return sentences


def _find_longest_run(recording: Recording, values: np.ndarray) -> tuple[int, int]:
    """Return first row and end of the longest sequence of equal readings in a continuous part."""
    read = np.isfinite(values) & (values != 0)
    new = np.r_[True, values[1:] != values[:-1]] | ~read | recording.starts
    bounds = np.r_[np.flatnonzero(new), values.size]
    lengths = np.where(read[bounds[:-1]], np.diff(bounds), 0)
    k = int(np.argmax(lengths))
    return int(bounds[k]), int(bounds[k] + lengths[k])


def _is_moving(channel: np.ndarray, first: int, last: int) -> bool:
    least = max(
        MIN_MOVED_RANGE_SHARE * _compute_range(channel), MIN_MOVED_VALUE_SHARE * float(np.nanmax(channel))
    )
    return _compute_range(channel[first:last]) > least


def _compute_range(values: np.ndarray) -> float:
    read = values[np.isfinite(values)]
    return float(np.ptp(read)) if read.size else 0.0
