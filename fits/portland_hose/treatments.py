"""Treatments of a recording that do not change its physics: a diagnosis of each must give the same names."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from block_medians import take_medians

from pamjax.records.case import Case

#: Slack rows: the largest pressure, as a share of the highest one, and the smallest contraction.
MAX_SLACK_PRESSURE_SHARE, MIN_SLACK_CONTRACTION = 0.1, 0.02


@dataclass(frozen=True)
class Treatment:
    """A treatment of a recording.

    Attributes:
        id: name of its files.
        title: text of the tables.
        change: function from the case as read to the changed case.
        samples: number of samples in a median, which is taken after the change.
    """

    id: str
    title: str
    change: Callable[[Case], Case] | None = None
    samples: int = 6

    def apply(self, case: Case) -> Case:
        """Return the case after the treatment."""
        changed = case if self.change is None else self.change(case)
        return take_medians(changed, self.samples)


def remove_force_noise(case: Case) -> Case:
    """Return the case without a stated noise of force, so that the diagnosis estimates it."""
    sensors = replace(case.muscle_toml.sensors, force=None)
    return replace(case, muscle_toml=replace(case.muscle_toml, sensors=sensors))


def compute_force_zero(case: Case) -> float:
    """Return the mean force of the slack rows, N.

    A row is slack if the hose is at least 2 % shorter than at rest and its pressure is at most 10 % of the
    highest one. The warning of `pamjax check` on the zero of a load cell uses the same rows.
    Neglects: the push of a thick tube that is compressed between fixed fittings.
    """
    recording = case.recording
    contraction = 1 - recording.length / case.muscle_toml.rest_length.value
    is_vented = recording.pressure <= MAX_SLACK_PRESSURE_SHARE * np.nanmax(recording.pressure)
    return float(np.nanmean(recording.force[is_vented & (contraction > MIN_SLACK_CONTRACTION)]))


def subtract_force_zero(case: Case) -> Case:
    """Return the case with zero mean force in its slack rows."""
    force = case.recording.force - compute_force_zero(case)
    return replace(case, recording=replace(case.recording, force=force))


def split_tests(case: Case) -> list[np.ndarray]:
    """Return the row indices of each test, in the order of the recording."""
    recording = case.recording
    is_first = (np.diff(recording.cycle) != 0) | (np.diff(recording.length) != 0)
    return np.split(np.arange(recording.n), np.flatnonzero(is_first) + 1)


def group_by_length(case: Case) -> list[list[np.ndarray]]:
    """Return the row indices of each test, grouped by length; lengths are in the order of the recording."""
    groups: dict[float, list[np.ndarray]] = {}
    for rows in split_tests(case):
        groups.setdefault(float(case.recording.length[rows[0]]), []).append(rows)
    return list(groups.values())


def keep_every_second_test(case: Case) -> Case:
    """Return the case with the first, third, … test of each length."""
    rows = np.concatenate([test for tests in group_by_length(case) for test in tests[::2]])
    return replace(case, recording=case.recording.select(np.sort(rows)))


def reverse_lengths(case: Case) -> Case:
    """Return the case with its lengths in reverse order, and new times.

    The tests of one length keep their order, and the pauses between tests keep theirs. Each test has a file
    of its own, and the order of the lengths in the recording is that of the import, not of a clock.
    """
    tests = [test for group in reversed(group_by_length(case)) for test in group]
    time = case.recording.time
    assert time is not None
    pauses = [time[b[0]] - time[a[-1]] for a, b in pairwise(split_tests(case))]
    new_times, start = [], float(time[0])
    for test, pause in zip(tests, [*pauses, 0.0], strict=True):
        new_times.append(time[test] - time[test[0]] + start)
        start = new_times[-1][-1] + pause
    reordered = case.recording.select(np.concatenate(tests))
    return replace(case, recording=replace(reordered, time=np.concatenate(new_times)))


#: All treatments; the first one is the reference, and the last one is the slowest.
TREATMENTS = (
    Treatment("medians-6", "medians of 6 (reference)"),
    Treatment("medians-20", "medians of 20", samples=20),
    Treatment("noise", "noise of force not stated", remove_force_noise),
    Treatment("zero", "zero of force subtracted", subtract_force_zero),
    Treatment("tests", "every second test", keep_every_second_test),
    Treatment("order", "lengths in reverse order", reverse_lengths),
    Treatment("medians-2", "medians of 2", samples=2),
)
REFERENCE = TREATMENTS[0]
