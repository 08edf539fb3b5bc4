"""Medians of neighbouring samples, to reduce the number of rows of a recording.

Samples of the hose recordings are 0.05 s apart and strongly correlated. Medians of six samples, 0.3 s
apart, shorten a diagnosis. A median never combines samples of two tests.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from pamjax.records.case import Case
from pamjax.records.recording import Recording


def take_medians(case: Case, samples: int = 6) -> Case:
    """Return the case with each block of samples replaced by its median.

    Args:
        case: recording with `time` and `cycle`; a new cycle or a new length starts a new test.
        samples: number of samples in a block; the last block of a test may be shorter.
    """
    recording = case.recording
    first = np.r_[True, (np.diff(recording.cycle) != 0) | (np.diff(recording.length) != 0)]
    start = np.maximum.accumulate(np.where(first, np.arange(recording.n), 0))
    block = np.cumsum(first | ((np.arange(recording.n) - start) % samples == 0)) - 1
    edges = np.flatnonzero(np.diff(block)) + 1

    def medians(values: np.ndarray) -> np.ndarray:
        return np.array([np.median(part) for part in np.split(values, edges)])

    assert recording.time is not None
    shorter = Recording.from_arrays(
        pressure=medians(recording.pressure),
        length=medians(recording.length),
        force=medians(recording.force),
        time=medians(recording.time),
        cycle=medians(recording.cycle).astype(int),
    )
    return dataclasses.replace(case, recording=shorter)
