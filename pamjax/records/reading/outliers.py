"""Wildly outlying samples: garbled cells are set aside by name and row, never silently.

A cell is set aside in two cases only:

* it stands alone: farther beyond both its neighbours in one continuous run than `ALONE` of the channel's
  range and `STEPS` of its larger steps; or
* it lies far outside: beyond the middle 80 % of the channel by `OUTSIDE` times their range, for at most
  `BRIEF` samples in a row.

Staircases, reversals and jumps between tests move one neighbour only, and drift and noise are small beside
the range. In seven hose recordings and 42 simulated ones the farthest good sample stood 0.08 of the range
beyond both its neighbours (the turn of a fast stroke) and 0.5 of the range outside; the limits are three
and eight times that. What is odd but not wild stays in: noise models can bear it, and it may be physics.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from pamjax.channels import DISPLAY_UNIT
from pamjax.records.recording import Aside, Recording
from pamjax.units import show

#: Share of the channel's range.
ALONE = 0.25
#: Multiple of the step that nine in ten are below: a stroke of four samples turns by whole steps.
STEPS = 5.0
#: Multiple of the channel's range.
OUTSIDE = 4.0
#: Samples: a transmission garbles a few, a rig that really went there stays longer.
BRIEF = 3
#: More outlying cells than this share are no accident, and are left for the user and the noise model.
RARE = 0.02
#: Fewer cells than this have no range to speak of.
ENOUGH = 8


def set_aside(recording: Recording, units: Mapping[str, str] | None = None) -> Recording:
    """The recording with its wildly outlying cells blanked and listed in `aside`.

    Args:
        recording: what was measured.
        units: unit in which each column is shown to a person, where it is not the usual one.
    """
    shown = {**DISPLAY_UNIT, **(units or {})}
    run = np.cumsum(recording.starts)
    cells: dict[str, np.ndarray] = {}
    notes: list[Aside] = []
    for name in ("pressure", "length", "force", "diameter"):
        found = outlying(getattr(recording, name), run, recording.has_time, shown[name])
        cells[name] = np.zeros(recording.n, dtype=bool)
        for i, why in found.items():
            cells[name][i] = True
            notes.append(
                Aside(int(recording.row[i]), name, float(getattr(recording, name)[i]), shown[name], why)
            )
    notes.sort(key=lambda aside: aside.row)
    return recording.without(cells, tuple(notes)) if notes else recording


def outlying(channel: np.ndarray, run: np.ndarray, ordered: bool, unit: str) -> dict[int, str]:
    """Indices of a channel's wildly outlying cells, each with the reason.

    Args:
        channel: (n,) SI, NaN where not measured.
        run: (n,) number of the continuous run that each row belongs to.
        ordered: whether neighbouring rows are neighbours in time.
        unit: unit for the reasons.
    """
    where = np.flatnonzero(np.isfinite(channel))
    if len(where) < ENOUGH:
        return {}
    x = channel[where]
    low, high = np.quantile(x, [0.1, 0.9])
    # A held channel has no range of its own: a fifth of its value stands in.
    span = max(high - low, 0.2 * float(np.median(np.abs(x))))
    outside = (x < low - OUTSIDE * span) | (x > high + OUTSIDE * span)
    alone = np.zeros(len(x), dtype=bool)
    if ordered:
        outside = _brief(outside, run[where])
        alone = _alone(x, run[where], span) & ~outside
    if (outside | alone).sum() > max(BRIEF, RARE * len(x)):
        return {}
    reasons = {int(where[i]): _why_outside(low, high, unit) for i in np.flatnonzero(outside)}
    return reasons | {int(where[i]): _why_alone(x[i - 1], x[i + 1], unit) for i in np.flatnonzero(alone)}


def _alone(x: np.ndarray, run: np.ndarray, span: float) -> np.ndarray:
    beyond = np.zeros(len(x))
    back, on = x[1:-1] - x[:-2], x[1:-1] - x[2:]
    beyond[1:-1] = np.maximum(np.minimum(back, on), np.minimum(-back, -on))
    beyond[1:-1][(run[1:-1] != run[:-2]) | (run[1:-1] != run[2:])] = 0.0
    larger_step = float(np.quantile(np.abs(np.diff(x)), 0.9))
    return beyond > max(ALONE * span, STEPS * larger_step)


def _brief(flags: np.ndarray, run: np.ndarray) -> np.ndarray:
    """The flags without stretches longer than `BRIEF` samples."""
    change = np.r_[True, (flags[1:] != flags[:-1]) | (run[1:] != run[:-1])]
    stretch = np.cumsum(change) - 1
    return flags & (np.bincount(stretch)[stretch] <= BRIEF)


def _why_outside(low: float, high: float, unit: str) -> str:
    return f"nearly all others lie between {show(low, unit)} and {show(high, unit)}"


def _why_alone(before: float, after: float, unit: str) -> str:
    return f"it stands alone between {show(before, unit)} and {show(after, unit)}"
