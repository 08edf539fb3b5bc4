"""A length that was held is one length, whatever its sensor's noise says of every sample.

A ramp of pressure is run between fixed ends. Noise of the recorded length passes for motion there: what
remembers where the muscle turned (friction) turns with every sample. Where the samples of a visit to one
length scatter by no more than neighbours differ by, nothing but noise moved, and their mean is that length,

    s < (1 + 1/4 + 2/√n) d,     s² = mean (l − l̄)²,     d² = mean (l_i+1 − l_i)² / 2.

What it leaves out: noise of a length sensor that repeats itself, which passes for motion; pressure, which a
regulator does move.
Source: derived here.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pamjax.records.blocks import LONG, blocks
from pamjax.records.case import Case

#: Share by which the scatter of a visit may exceed what neighbours differ by, beyond chance.
MORE = 0.25
#: Share of the rows of a recording that were held from which its lengths have no other noise.
MOSTLY = 0.9


def held(case: Case) -> Case:
    """The case with every held length as one; as it is where lengths are not held, or have no noise.

    Args:
        case: a recording and what the lab says of it. Of rulers that are read once a setting nothing is
            changed: their error is one for each.
    """
    recording, sensors = case.recording, case.entry.sensors
    if recording.time is None or sensors.length_per_setting:
        return case
    found = blocks(recording)
    if found.kind != "lengths":
        return case
    length, still, sizes = recording.length.copy(), np.zeros(recording.n, dtype=bool), []
    for rows in _visits(found.label, recording.starts):
        if _is_still(recording.length[rows]):
            length[rows] = recording.length[rows].mean()
            still[rows] = True
            sizes.append(rows.size)
    if not sizes:
        return case
    entry = case.entry
    if sensors.length is not None and still.mean() >= MOSTLY:
        of_mean = sensors.length / float(np.sqrt(np.median(sizes)))
        entry = replace(entry, sensors=replace(sensors, length=of_mean))
    return replace(case, recording=replace(recording, length=length), entry=entry)


def _visits(label: np.ndarray, starts: np.ndarray) -> list[np.ndarray]:
    """Rows of each stay at one setting; a longer one ends where the recording was interrupted."""
    cuts = np.flatnonzero((np.diff(label) != 0) | starts[1:]) + 1
    return [rows for rows in np.split(np.arange(label.size), cuts) if label[rows[0]] >= 0]


def _is_still(length: np.ndarray) -> bool:
    if length.size < LONG:
        return False
    scatter, step = np.std(length), np.sqrt(np.mean(np.diff(length) ** 2) / 2)
    return bool(0 < scatter < (1 + MORE + 2 / np.sqrt(length.size)) * step)
