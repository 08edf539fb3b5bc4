"""Rows that a fit does not use are reported with their reason."""

from dataclasses import replace

import numpy as np

from pamjax.infer.problem.informative_samples import count_informative_samples
from pamjax.infer.problem.row_counts import describe_unused_rows
from pamjax.records.recording import Recording
from tests.infer.made import made


def ramps():
    """Return a case with ramps at four lengths: it is slack at the shortest (50 rows)."""
    ramp = np.linspace(0.0, 1.0, 50)
    recording = Recording.from_arrays(
        time=np.arange(200.0),
        pressure=6e5 * np.tile(ramp, 4),
        length=np.repeat([0.2357, 0.22, 0.21, 0.15], 50),
        force=np.concatenate([np.tile(400.0 + 300.0 * ramp, 3), 0.1 * ramp]),
        diameter=np.full(200, np.nan),
        cycle=np.repeat([1, 2, 3, 4], 50),
    )
    return replace(made("elastic"), recording=recording)


def test_slack_rows_are_counted():
    case = ramps()
    (line,) = describe_unused_rows(case)
    assert line == "force: 200 rows, 150 used, 50 without information (slack muscle)"
    assert count_informative_samples(case) == 150


def test_blank_cells_are_counted():
    case = ramps()
    case.recording.force[[3, 7]] = np.nan
    case.recording.length[5] = np.nan
    (line,) = describe_unused_rows(case)
    assert line == "force: 200 rows, 147 used, 50 without information (slack muscle), 3 without a value"


def test_diameter_without_pressure_is_counted():
    case = ramps()
    case = replace(case, recording=replace(case.recording, diameter=np.full(200, 0.03)))
    _, line = describe_unused_rows(case)
    assert line.startswith("diameter: 200 rows, 147 used, 50 without information (slack muscle), 3 without")
    assert line.endswith("information (pressure near zero)")


def test_complete_recording_needs_no_line():
    assert list(describe_unused_rows(made("elastic"))) == []
