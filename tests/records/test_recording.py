"""A recording: its measured channels, and where its history restarts."""

import subprocess
import sys

import numpy as np
import pytest

from pamjax.errors import BadInput
from pamjax.records.recording import Outlier, Recording


def ramp(n=40):
    return Recording.from_arrays(
        time=np.arange(n) * 0.5, pressure=np.linspace(1e5, 2e5, n), length=0.2, force=np.arange(n) * 1.0
    )


def test_channels_are_those_with_a_measured_cell():
    recording = Recording.from_arrays(pressure=[1e5, 2e5], length=0.2, diameter=[np.nan, 0.02])
    assert recording.channels == ("diameter",)
    assert recording.n == len(recording) == 2
    assert recording.cycle.tolist() == [1, 1]
    assert recording.row.tolist() == [2, 3]


def test_usable_rows_have_pressure_and_length():
    recording = Recording.from_arrays(pressure=[1e5, np.nan, 2e5], length=[0.2, 0.2, np.nan])
    assert recording.usable.tolist() == [True, False, False]


def test_history_restarts_at_every_row_of_a_static_map():
    recording = Recording.from_arrays(pressure=[1e5, 2e5], length=0.2, force=[1.0, 2.0])
    assert not recording.has_time
    assert recording.is_run_start.tolist() == [True, True]


def test_history_restarts_after_a_pause_only():
    steps = np.r_[np.full(10, 0.5), 6.0, np.full(10, 0.5)]
    even = Recording.from_arrays(time=np.r_[0.0, np.cumsum(steps)], pressure=np.full(22, 1e5), length=0.2)
    assert np.flatnonzero(even.is_run_start).tolist() == [0, 11]
    spread_out = np.r_[0.0, np.cumsum(0.1 * 1.5 ** np.arange(12))]
    creep = Recording.from_arrays(time=spread_out, pressure=np.full(13, 1e5), length=0.2)
    assert np.flatnonzero(creep.is_run_start).tolist() == [0]


def test_history_restarts_if_time_decreases():
    recording = Recording.from_arrays(time=[0.0, 1.0, 2.0, 0.0, 1.0], pressure=np.full(5, 1e5), length=0.2)
    assert np.flatnonzero(recording.is_run_start).tolist() == [0, 3]


@pytest.mark.parametrize(("jump", "starts"), [(True, [0, 20]), (False, [0])])
def test_history_restarts_at_a_cycle_with_a_jump_of_settings(jump, starts):
    pressure = np.linspace(1e5, 2e5, 40)
    pressure[20:] += 3e4 if jump else 0.0
    recording = Recording.from_arrays(
        time=np.arange(40.0), pressure=pressure, length=0.2, cycle=np.repeat([1, 2], 20)
    )
    assert np.flatnonzero(recording.is_run_start).tolist() == starts


def test_history_continues_at_a_jump_within_a_cycle():
    pressure = np.repeat([1e5, 2e5], 20)
    recording = Recording.from_arrays(time=np.arange(40.0), pressure=pressure, length=0.2)
    assert np.flatnonzero(recording.is_run_start).tolist() == [0]


def test_selection_keeps_line_numbers_and_remarks():
    outliers = (Outlier(3, "force", 9e9, "N", "x"), Outlier(30, "force", 9e9, "N", "x"))
    recording = ramp().blank_cells({"force": np.arange(40) == 1}, outliers)
    part = recording.select(recording.row < 10)
    assert part.row.tolist() == list(range(2, 10))
    assert part.outliers == outliers[:1]
    assert np.isnan(part.force[1])


def test_columns_must_have_equal_lengths():
    with pytest.raises(BadInput) as error:
        Recording.from_arrays(pressure=[1e5, 2e5], length=0.2, force=[1.0])
    assert str(error.value) == (
        "`force` must have as many rows as `pressure`; got shapes (1,) and (2,). Pass one value for each row."
    )


def test_table_has_display_units():
    frame = ramp().to_frame()
    assert list(frame) == ["time [s]", "pressure [kPa]", "length [mm]", "force [N]", "cycle"]
    assert frame["pressure [kPa]"].iloc[0] == pytest.approx(100.0, rel=1e-12)


def test_outlier_is_described_in_a_sentence():
    outlier = Outlier(17, "pressure", 4e7, "kPa", "its neighbours are 100 kPa and 101 kPa")
    text = "outlier pressure 40000 kPa in row 17: ignored, because its neighbours are 100 kPa and 101 kPa"
    assert str(outlier) == text


def test_reading_records_loads_no_jax():
    """JAX takes most of a second to load, which is too long for reading a table."""
    modules = [
        "blocks",
        "case",
        "files",
        "recording",
        "reading.muscle_toml",
        "reading.table",
        "writing.template",
    ]
    code = (
        f"import sys; sys.modules['jax'] = None; import {', '.join('pamjax.records.' + m for m in modules)}"
    )
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
