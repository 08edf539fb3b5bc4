"""Samples of a recording that are informative about the model, and their noise before a fit."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from pamjax.records.blocks import find_blocks
from pamjax.records.case import Case

#: A muscle is slack if its force is below this fraction of the largest force.
MAX_SLACK_FORCE_SHARE = 0.02

#: Smallest significant pressure, standard deviations of its sensor.
_MIN_PRESSURE_SD = 3.0

#: Smallest pressure, relative to the highest, at which the length at a set force is informative.
_MIN_INFLATED_SHARE = 0.01

#: Number of samples in the running median that detects a slack muscle: maximum, and fraction of the block.
_MAX_MEDIAN_SAMPLES, _MEDIAN_BLOCK_SHARE = 15, 1 / 30
#: Largest noise of a sample, standard deviations of the load cell.
_MAX_NOISE_SD = 4.0


def find_slack_samples(case: Case) -> np.ndarray:
    """Return whether the muscle exerts nearly no force, (n,), by a running median of the force.

    A criterion on the sample's own force would select samples by their noise, and bias the force near the
    threshold. Only a sample that is below the threshold by more than noise is slack by its own force. Where a
    muscle tightens quickly, the neighbours have a force. A set force of zero does not mean a slack muscle.
    """
    if case.recording.measures_length:
        return np.zeros(case.recording.n, dtype=bool)
    recording, sd = case.recording, case.muscle_toml.sensors.force
    top = np.nanmax(np.abs(recording.force[recording.usable]), initial=0.0)
    limit = MAX_SLACK_FORCE_SHARE * top
    force = np.where(recording.usable, recording.force, np.nan)
    is_slack = np.zeros(recording.n, dtype=bool)
    if not (force < limit).any():
        return is_slack
    if recording.time is None:
        # The rows of a static table have no order, and so no neighbours.
        is_slack[:] = force < limit
    else:
        for rows in _split_by_block(find_blocks(recording).label):
            width = max(1, min(_MAX_MEDIAN_SAMPLES, int(_MEDIAN_BLOCK_SHARE * rows.size)))
            is_slack[rows] = has_median_below(force[rows], limit, width)
    is_slack[force < limit - _MAX_NOISE_SD * (np.inf if sd is None else sd)] = True
    return is_slack


def _split_by_block(label: np.ndarray) -> list[np.ndarray]:
    """Return the rows of each block, in order; those without a block are one more."""
    order = np.argsort(label, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(label[order])) + 1)


def has_median_below(values: np.ndarray, threshold: float, width: int) -> np.ndarray:
    """Return whether the median of the measured neighbours of a value is below a threshold, (n,) bool.

    Args:
        values: (n,), NaN where not measured.
        threshold: the threshold.
        width: number of neighbours, the value itself included.
    """
    padded_values = np.pad(values, (width // 2, (width - 1) // 2), constant_values=np.nan)
    neighbours = sliding_window_view(padded_values, width)
    # Other medians are above the threshold, and need no sorting.
    is_below = np.asarray((neighbours < threshold).any(axis=1))
    # Sorting puts the values that are not measured last.
    ordered = np.sort(neighbours[is_below], axis=1)
    count = np.isfinite(ordered).sum(axis=1)
    row = np.arange(len(ordered))
    is_below[is_below] = (ordered[row, (count - 1) // 2] + ordered[row, count // 2]) / 2 < threshold
    return is_below


def find_informative_samples(case: Case, channel: str) -> np.ndarray:
    """Return whether a sample of a channel is informative about the model, (n,).

    At a fixed length, the force of a slack or bowed muscle is zero for any parameters, so it is excluded. On
    a stroke, it locates the end of the stroke, and is included. At a fixed length, the diameter of a slack
    muscle, or of one without significant pressure, is arbitrary, so it is excluded too. Without stated noise
    of the pressure sensor, every pressure above zero is significant. At a set force, the length is not
    informative without significant pressure, which is also at least `_MIN_INFLATED_SHARE` of the highest.
    """
    informative = case.recording.usable & np.isfinite(getattr(case.recording, channel))
    if case.recording.measures_length:
        pressure = case.recording.pressure
        threshold = _MIN_INFLATED_SHARE * np.nanmax(pressure[case.recording.usable], initial=0.0)
        noise = _MIN_PRESSURE_SD * (case.muscle_toml.sensors.pressure or 0.0)
        return informative & np.isfinite(case.recording.force) & (pressure > max(threshold, noise))
    if find_blocks(case.recording).kind != "lengths":
        return informative
    informative = informative & ~find_slack_samples(case)
    if channel == "force":
        return informative
    return informative & (
        case.recording.pressure > _MIN_PRESSURE_SD * (case.muscle_toml.sensors.pressure or 0.0)
    )


def count_informative_samples(case: Case) -> int:
    """Return the number of informative samples of all channels that a model predicts."""
    return sum(int(find_informative_samples(case, c).sum()) for c in case.recording.model_channels)


def estimate_starting_sd(case: Case) -> tuple[float, float]:
    """Return the standard deviations of force (N), or a measured length (m), and diameter (m) at the start.

    Each is the stated sd of the sensor. Without one, it is one percent of the channel's range. This sets the
    weights of the first fit, and is then replaced by the rms residual.
    """
    first, diameter = (
        stated or _compute_one_percent(getattr(case.recording, name))
        for name, stated in zip(case.recording.model_channels, get_stated_sds(case), strict=True)
    )
    return first, diameter


def get_stated_sds(case: Case) -> tuple[float | None, float | None]:
    """Return the stated noise of force, or of a measured length, and of diameter, SI; None if not stated."""
    sensors = case.muscle_toml.sensors
    return sensors.length if case.recording.measures_length else sensors.force, sensors.diameter


def _compute_one_percent(channel: np.ndarray) -> float:
    measured = channel[np.isfinite(channel)]
    value_range = float(np.ptp(measured)) if measured.size > 1 else 0.0
    return 0.01 * value_range or 1.0
