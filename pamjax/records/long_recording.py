"""Advice on recordings with so many rows that a diagnosis takes long."""

from __future__ import annotations

import math

import numpy as np

from pamjax.records.recording import Recording

#: A diagnosis of more rows can take several minutes (docs/performance.md).
MANY_ROWS = 5000

#: Number of rows to which the advice reduces a recording.
_ADVISED_ROWS = 2500


def advise_reduction(recording: Recording) -> list[str]:
    """Return how to reduce the rows of a recording before a diagnosis; empty for a short one."""
    if recording.n <= MANY_ROWS or recording.time is None:
        return []
    intervals = np.diff(recording.time)[~recording.is_run_start[1:]]
    if not intervals.size:
        return []
    duration = math.ceil(recording.n / _ADVISED_ROWS) * float(np.median(intervals))
    return [
        f"A diagnosis of {recording.n:,} rows can take several minutes.",
        f'Into a new folder, `pamjax import` with `median = "{duration:.2g} s"` in its TOML file writes at'
        f" most about {_ADVISED_ROWS:,} rows.",
    ]
