"""Sensors that stand still while the muscle does not.

A load cell at the end of its range, a cable that came off, or a weight that was written down where a
measurement belongs: the reading repeats itself to the last digit, and physics would be looked for in it.
"""

from __future__ import annotations

import numpy as np

from pamjax.channels import DISPLAY_UNIT
from pamjax.records.recording import Recording
from pamjax.units import show

#: Readings alike one after another, rows and share of all of them, from which on a channel stands still.
ROWS, SHARE = 20, 0.1
#: Shares of its range, and of its largest value, through which pressure or length goes if the muscle moves.
MOVES, MORE_THAN_NOISE = 0.2, 0.01


def stuck(recording: Recording, file: str) -> list[str]:
    """One sentence for each of force and diameter that stands still while the muscle does not.

    Force answers to pressure and length, diameter to length; what pressure adds may hide in its last digit.

    Args:
        recording: what was measured, SI. A force of nothing is that of a slack muscle.
        file: name of the CSV file.
    """
    said = []
    moved_by = {
        "force": (recording.pressure, recording.length),
        "diameter": (recording.length,),
    }
    for name, by in moved_by.items():
        if name not in recording.channels:
            continue
        values = getattr(recording, name)
        first, last = _longest(recording, values)
        enough = max(ROWS, SHARE * np.isfinite(values).sum())
        if last - first >= enough and any(_moves(channel, first, last) for channel in by):
            rows = f"rows {recording.row[first]} to {recording.row[last - 1]}"
            said.append(
                f"`{name}` reads {show(values[first], DISPLAY_UNIT[name])} in {rows} of {file}, while the"
                " muscle is moved. Blank it there if its sensor was stuck, at its limit, or not read."
            )
    return said


def _longest(recording: Recording, values: np.ndarray) -> tuple[int, int]:
    """Begin and end of the longest run of one reading, to the last digit, in a continuous part."""
    read = np.isfinite(values) & (values != 0)
    new = np.r_[True, values[1:] != values[:-1]] | ~read | recording.starts
    bounds = np.r_[np.flatnonzero(new), values.size]
    lengths = np.where(read[bounds[:-1]], np.diff(bounds), 0)
    k = int(np.argmax(lengths))
    return int(bounds[k]), int(bounds[k] + lengths[k])


def _moves(channel: np.ndarray, first: int, last: int) -> bool:
    least = max(MOVES * _range(channel), MORE_THAN_NOISE * float(np.nanmax(channel)))
    return _range(channel[first:last]) > least


def _range(values: np.ndarray) -> float:
    read = values[np.isfinite(values)]
    return float(np.ptp(read)) if read.size else 0.0
