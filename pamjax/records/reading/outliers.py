"""Detection of gross outliers, such as corrupted cells; each one is reported with column and row.

A cell is an outlier in two cases only:

* spike: it differs from both neighbours of one continuous part, in the same direction, by more than
  `_MIN_SPIKE_RANGE_SHARE` of the channel's range and `_MIN_SPIKE_STEPS` of its larger steps.
* outside: it is beyond the middle 80 % of the channel by more than `_MIN_OUTSIDE_RANGES` times their range,
  for at most `_MAX_OUTLIER_RUN` consecutive samples.

A staircase, a reversal or a jump between tests differs from one neighbour only. Drift and noise are small
compared with the range. In seven hose recordings and 42 simulated ones, the most extreme good spike is 0.08
of the range (reversal of a fast stroke). The most extreme good value is 0.5 of the range outside. The limits
are three and eight times these values. Smaller deviations are kept: they may be noise or physics.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pamjax.channels import DISPLAY_UNIT
from pamjax.records.recording import Outlier, Recording
from pamjax.units import format_quantity

#: Minimum size of a spike, as a share of the channel's range.
_MIN_SPIKE_RANGE_SHARE = 0.25
#: Minimum size of a spike, as a multiple of the 90 % quantile of the steps; a coarse stroke has large steps.
_MIN_SPIKE_STEPS = 5.0
#: Minimum distance of a value outside the middle 80 %, as a multiple of their range.
_MIN_OUTSIDE_RANGES = 4.0
#: Maximum number of consecutive outliers: transmission errors are short, real states of the rig last longer.
_MAX_OUTLIER_RUN = 3
#: Maximum share of outliers: with more of them, all cells are kept for the user and the noise model.
_MAX_OUTLIER_SHARE = 0.02
#: Minimum number of measured cells for a range.
_MIN_CELLS_FOR_RANGE = 8


def remove_outliers(recording: Recording, units: Mapping[str, str] | None = None) -> Recording:
    """Return the recording with outlying cells blanked and listed in `outliers`.

    Args:
        recording: the recording.
        units: unit of each column in messages, if not the display unit.
    """
    column_units = {**DISPLAY_UNIT, **(units or {})}
    run_number = np.cumsum(recording.is_run_start)
    cells: dict[str, np.ndarray] = {}
    outliers: list[Outlier] = []
    for name in ("pressure", "length", "force", "diameter"):
        reasons = _find_outliers(getattr(recording, name), run_number, recording.has_time, column_units[name])
        cells[name] = np.zeros(recording.n, dtype=bool)
        for i, reason in reasons.items():
            cells[name][i] = True
            outliers.append(
                Outlier(
                    int(recording.row[i]),
                    name,
                    float(getattr(recording, name)[i]),
                    column_units[name],
                    reason,
                )
            )
    outliers.sort(key=lambda outlier: outlier.row)
    return recording.blank_cells(cells, tuple(outliers)) if outliers else recording


def _find_outliers(
    channel: np.ndarray, run_number: np.ndarray, is_time_series: bool, unit: str
) -> dict[int, str]:
    """Return the indices of a channel's outlying cells, each with its reason.

    Args:
        channel: (n,) SI, NaN where not measured.
        run_number: (n,) number of each row's continuous part.
        is_time_series: whether the rows are a time series.
        unit: unit in the reasons.
    """
    measured_rows = np.flatnonzero(np.isfinite(channel))
    if len(measured_rows) < _MIN_CELLS_FOR_RANGE:
        return {}
    x = channel[measured_rows]
    low, high = np.quantile(x, [0.1, 0.9])
    # A constant channel has almost no range. Its range is then a fifth of its value.
    span = max(high - low, 0.2 * float(np.median(np.abs(x))))
    is_outside = (x < low - _MIN_OUTSIDE_RANGES * span) | (x > high + _MIN_OUTSIDE_RANGES * span)
    is_spike = np.zeros(len(x), dtype=bool)
    if is_time_series:
        is_outside = _keep_brief_runs(is_outside, run_number[measured_rows])
        is_spike = _find_spikes(x, run_number[measured_rows], span) & ~is_outside
    if (is_outside | is_spike).sum() > max(_MAX_OUTLIER_RUN, _MAX_OUTLIER_SHARE * len(x)):
        return {}
    reasons = {
        int(measured_rows[i]): _format_outside_reason(low, high, unit) for i in np.flatnonzero(is_outside)
    }
    return reasons | {
        int(measured_rows[i]): _format_spike_reason(x[i - 1], x[i + 1], unit)
        for i in np.flatnonzero(is_spike)
    }


def _find_spikes(x: np.ndarray, run_number: np.ndarray, span: float) -> np.ndarray:
    excess = np.zeros(len(x))
    to_previous, to_next = x[1:-1] - x[:-2], x[1:-1] - x[2:]
    excess[1:-1] = np.maximum(np.minimum(to_previous, to_next), np.minimum(-to_previous, -to_next))
    excess[1:-1][(run_number[1:-1] != run_number[:-2]) | (run_number[1:-1] != run_number[2:])] = 0.0
    larger_step = float(np.quantile(np.abs(np.diff(x)), 0.9))
    return excess > max(_MIN_SPIKE_RANGE_SHARE * span, _MIN_SPIKE_STEPS * larger_step)


def _keep_brief_runs(flags: np.ndarray, run_number: np.ndarray) -> np.ndarray:
    """Return the flags without sequences longer than `_MAX_OUTLIER_RUN` samples."""
    change = np.r_[True, (flags[1:] != flags[:-1]) | (run_number[1:] != run_number[:-1])]
    stretch = np.cumsum(change) - 1
    return flags & (np.bincount(stretch)[stretch] <= _MAX_OUTLIER_RUN)


def _format_outside_reason(low: float, high: float, unit: str) -> str:
    return f"most values are between {format_quantity(low, unit)} and {format_quantity(high, unit)}"


def _format_spike_reason(before: float, after: float, unit: str) -> str:
    return f"its neighbours are {format_quantity(before, unit)} and {format_quantity(after, unit)}"
