"""A length that was held is one length, whatever its sensor's noise says of every sample.

A ramp of pressure is run between fixed ends. Noise of the recorded length passes for motion there: what
remembers where the muscle turned (friction) turns with every sample. Where a visit to one length shows
nothing but noise, its mean is that length. With d the noise that neighbours show, of their median difference,

    near      |l − median l| < 4 d; what is farther, on the way there or off, is no part of the visit
    steady    s < (1 + 1/4 + 3/√n) d,     s² = mean (l − l̄)² of what is near
    no drift  Σ m (l̄_k − l̄)² / d² of eight stretches of m samples is no rarer than one in a thousand

and the error of a mean is the same at all its samples: from then on one number for each length that was set.

What it leaves out: noise of a length sensor that repeats itself, which passes for motion; pressure, which a
regulator does move; recordings of fewer lengths than blocks are made of.
Source: derived here.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.stats import chi2

from pamjax.records.blocks import find_blocks
from pamjax.records.case import Case

#: Samples of the shortest visit; a visit has so many stretches, of five samples at least.
MIN_VISIT_SAMPLES, MAX_VISIT_STRETCHES, MIN_STRETCH_SAMPLES = 16, 8, 5
#: Noise that neighbours show beyond which a sample is no part of a visit, and the share of near ones.
MAX_VISIT_DEVIATION_SD, MIN_SHARE_AT_REST = 4.0, 0.8
#: Share by which the scatter of a visit may exceed what neighbours differ by, beyond chance.
MAX_EXCESS_SCATTER = 0.25
#: Chance that stretches of noise alone lie as far apart.
DRIFT_SIGNIFICANCE = 1e-3
#: Median of |difference of two| of a normal variable, in standard deviations.
NORMAL_DIFFERENCE_MEDIAN = 0.9539
#: Share of the rows of a recording that were held from which its lengths have no other noise: what moved
#: is then compared as if its length were exact.
MIN_FIXED_ROW_SHARE = 0.99


def average_fixed_lengths(case: Case) -> Case:
    """The case with every held length as one; as it is where lengths are not held, or have no noise.

    Args:
        case: a recording and what the lab says of it. Of rulers that are read once a setting nothing is
            changed: their error is one for each.
    """
    recording, sensors = case.recording, case.entry.sensors
    if recording.time is None or sensors.length_per_setting:
        return case
    case_blocks = find_blocks(recording)
    if case_blocks.kind != "lengths":
        return case
    length, is_fixed, sizes = recording.length.copy(), np.zeros(recording.n, dtype=bool), []
    for rows in _find_visits(case_blocks.label, recording.starts):
        rest = rows[find_rest_samples(recording.length[rows])]
        if rest.size:
            length[rest] = recording.length[rest].mean()
            is_fixed[rest] = True
            sizes.append(rest.size)
    if not sizes:
        return case
    entry = case.entry
    if sensors.length is not None and is_fixed.mean() >= MIN_FIXED_ROW_SHARE:
        of_mean = sensors.length / float(np.sqrt(np.median(sizes)))
        entry = replace(entry, sensors=replace(sensors, length=of_mean, length_per_setting=True))
    return replace(case, recording=replace(recording, length=length), entry=entry)


def _find_visits(label: np.ndarray, starts: np.ndarray) -> list[np.ndarray]:
    """Rows of each stay at one setting; a longer one ends where the recording was interrupted."""
    cuts = np.flatnonzero((np.diff(label) != 0) | starts[1:]) + 1
    return [rows for rows in np.split(np.arange(label.size), cuts) if label[rows[0]] >= 0]


def find_rest_samples(length: np.ndarray) -> np.ndarray:
    """(n,) which samples of a visit, (n,) m, show one length and noise; none where it moved."""
    none = np.zeros(length.size, dtype=bool)
    if length.size < MIN_VISIT_SAMPLES:
        return none
    noise = float(np.median(np.abs(np.diff(length)))) / NORMAL_DIFFERENCE_MEDIAN
    near = np.abs(length - np.median(length)) < MAX_VISIT_DEVIATION_SD * noise
    if near.mean() < MIN_SHARE_AT_REST:
        return none
    steady = np.std(length[near]) < (1 + MAX_EXCESS_SCATTER + 3 / np.sqrt(length.size)) * noise
    return near if steady and not _has_drift(length[near], noise) else none


def _has_drift(length: np.ndarray, noise: float) -> bool:
    """Whether stretches of a visit lie farther apart than noise puts them."""
    parts = np.array_split(length, min(MAX_VISIT_STRETCHES, length.size // MIN_STRETCH_SAMPLES))
    apart = sum(part.size * (part.mean() - length.mean()) ** 2 for part in parts) / noise**2
    return bool(chi2.sf(apart, len(parts) - 1) < DRIFT_SIGNIFICANCE)
