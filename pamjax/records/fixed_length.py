"""Averaging of the length during fixed-length (isometric) tests.

In a fixed-length test, sensor noise of the length looks like motion, and mechanisms with memory (friction)
reverse at every sample. If the samples at one length level differ only by noise, they are replaced by their
mean. The noise d is the standard deviation from the median difference of neighbouring samples. The tests are:

    near      |l − median l| < 4 d; other samples are transitions and are left out
    steady    s < (1 + 1/4 + 3/√n) d,     s² = mean (l − l̄)² of the near samples
    no drift  Σ m (l̄_k − l̄)² / d² of eight parts of m samples: p-value at least 0.001

The error of a mean is the same at all its samples. The length error is then one number for each level.

Left out: autocorrelated noise of the length sensor, which looks like motion, and recordings with too few
lengths to form blocks. The pressure is not averaged, because its variation is real.
Source: derived here.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from pamjax.records.blocks import find_blocks
from pamjax.records.case import Case

#: Minimum samples at one level; maximum number of its parts; minimum samples of a part.
_MIN_VISIT_SAMPLES, _MAX_VISIT_PARTS, _MIN_PART_SAMPLES = 16, 8, 5
#: Maximum deviation of a near sample in units of the noise d, and minimum share of near samples.
_MAX_VISIT_DEVIATION_SD, _MIN_SHARE_AT_REST = 4.0, 0.8
#: Share by which the scatter at one level may exceed the noise d, in addition to chance.
_MAX_EXCESS_SCATTER = 0.25
#: Significance level of the drift test.
_DRIFT_SIGNIFICANCE = 1e-3
#: Median of the absolute difference of two normal samples, in standard deviations.
_NORMAL_DIFFERENCE_MEDIAN = 0.9539
#: Minimum share of averaged rows for which the length error becomes the error of the means. The other rows
#: then have the same small error.
_MIN_FIXED_ROW_SHARE = 0.99


def average_fixed_lengths(case: Case) -> Case:
    """Return the case with the length averaged at each fixed length.

    The case is unchanged if its blocks are not lengths, or if the length is what was measured. It is also
    unchanged if its length error is stated per level.

    Args:
        case: the case to average.
    """
    recording, sensors = case.recording, case.muscle_toml.sensors
    if recording.time is None or recording.measures_length or sensors.length_per_level:
        return case
    case_blocks = find_blocks(recording)
    if case_blocks.kind != "lengths":
        return case
    length, is_fixed, sizes = recording.length.copy(), np.zeros(recording.n, dtype=bool), []
    for rows in _find_visits(case_blocks.label, recording.is_run_start):
        rest_rows = rows[find_rest_samples(recording.length[rows])]
        if rest_rows.size:
            length[rest_rows] = recording.length[rest_rows].mean()
            is_fixed[rest_rows] = True
            sizes.append(rest_rows.size)
    if not sizes:
        return case
    muscle_toml = case.muscle_toml
    if sensors.length is not None and is_fixed.mean() >= _MIN_FIXED_ROW_SHARE:
        sd_of_mean = sensors.length / float(np.sqrt(np.median(sizes)))
        muscle_toml = replace(muscle_toml, sensors=replace(sensors, length=sd_of_mean, length_per_level=True))
    return replace(case, recording=replace(recording, length=length), muscle_toml=muscle_toml)


def _find_visits(label: np.ndarray, is_run_start: np.ndarray) -> list[np.ndarray]:
    """Return the rows of each continuous sequence at one level."""
    cuts = np.flatnonzero((np.diff(label) != 0) | is_run_start[1:]) + 1
    return [rows for rows in np.split(np.arange(label.size), cuts) if label[rows[0]] >= 0]


def find_rest_samples(length: np.ndarray) -> np.ndarray:
    """Return the mask of the samples, (n,) bool, that show one length and noise; all False if it moved.

    Args:
        length: (n,) m, the samples at one level.
    """
    no_samples = np.zeros(length.size, dtype=bool)
    if length.size < _MIN_VISIT_SAMPLES:
        return no_samples
    noise = float(np.median(np.abs(np.diff(length)))) / _NORMAL_DIFFERENCE_MEDIAN
    is_near = np.abs(length - np.median(length)) < _MAX_VISIT_DEVIATION_SD * noise
    if is_near.mean() < _MIN_SHARE_AT_REST:
        return no_samples
    is_steady = np.std(length[is_near]) < (1 + _MAX_EXCESS_SCATTER + 3 / np.sqrt(length.size)) * noise
    return is_near if is_steady and not _has_drift(length[is_near], noise) else no_samples


def _has_drift(length: np.ndarray, noise: float) -> bool:
    """Return whether the means of the parts differ by more than noise."""
    from scipy.special import chdtrc

    parts = np.array_split(length, min(_MAX_VISIT_PARTS, length.size // _MIN_PART_SAMPLES))
    chi_squared = sum(part.size * (part.mean() - length.mean()) ** 2 for part in parts) / noise**2
    return bool(chdtrc(len(parts) - 1, chi_squared) < _DRIFT_SIGNIFICANCE)
