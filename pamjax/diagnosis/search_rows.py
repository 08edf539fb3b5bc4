"""Rows of a recording in which mechanisms are searched.

The duration of a search is proportional to the number of rows. Samples of a long recording resolve its
strokes many times over. A search needs no more of them than one tenth of its shape parameters, so it takes
every second, third, … row. The chosen mechanisms are then fitted to all rows.

Neglects: effects that are faster than the interval of the rows that are taken.
"""

from __future__ import annotations

import math

import numpy as np

from pamjax.records.blocks import assign_length_levels
from pamjax.records.recording import Recording


def choose_search_rows(recording: Recording, max_rows: int) -> np.ndarray:
    """Return the row indices for a search, (k,): every m-th row of each run, m = ⌈n / `max_rows`⌉.

    All rows are taken if they are no time series, or if fewer rows show other length levels.
    """
    all_rows = np.arange(recording.n)
    if recording.n <= max_rows or recording.time is None:
        return all_rows
    run_start = np.maximum.accumulate(np.where(recording.is_run_start, all_rows, 0))
    rows = np.flatnonzero((all_rows - run_start) % math.ceil(recording.n / max_rows) == 0)
    levels = assign_length_levels(recording)[rows]
    is_same = np.array_equal(assign_length_levels(recording.select(rows)), levels)
    return rows if is_same else all_rows
