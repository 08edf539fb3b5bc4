"""A written case is the same after reading, within the sensor resolution."""

import dataclasses

import numpy as np
import pytest
import tomlkit

from pamjax.errors import BadInput
from pamjax.records.case import read_case
from pamjax.records.recording import Recording
from pamjax.records.writing.case_folder import COLUMN_DECIMALS, write_case
from pamjax.units import compute_si_factor

MUSCLE = """\
# a comment
[muscle]
rest_length = "200 mm"
thread_length = {value = "214 mm", sd = "0.5 mm"}
turns = 1.2

[columns]
force = "Load (lbf)"
"""
N = 40
LENGTH = np.linspace(0.2, 0.17, N)
RECORDING = Recording.from_arrays(
    time=np.arange(N) / 3,
    pressure=np.full(N, 2e5) + np.linspace(0, 1, N),
    length=LENGTH,
    force=2e5 * (3 * LENGTH**2 - 0.214**2) / (4 * np.pi * 1.2**2),
    diameter=np.where(np.arange(N) % 3 == 0, np.sqrt(0.214**2 - LENGTH**2) / (np.pi * 1.2), np.nan),
    cycle=np.repeat([1, 2], N // 2),
)


def test_recording_is_unchanged_after_writing_and_reading(tmp_path):
    write_case(tmp_path / "new", RECORDING, MUSCLE)
    again = read_case(tmp_path / "new").recording
    units = {"time": "s", "pressure": "kPa", "length": "mm", "force": "N", "diameter": "mm"}
    for name, digits in COLUMN_DECIMALS.items():
        half = 0.5 * 10.0**-digits * compute_si_factor(units[name])
        np.testing.assert_allclose(getattr(again, name), getattr(RECORDING, name), rtol=0, atol=1.001 * half)
    np.testing.assert_array_equal(again.cycle, RECORDING.cycle)
    np.testing.assert_array_equal(again.row, RECORDING.row)


def test_unmeasured_channel_has_no_column(tmp_path):
    bare = dataclasses.replace(RECORDING, time=None, diameter=np.full(N, np.nan))
    write_case(tmp_path / "new", bare, MUSCLE)
    header = (tmp_path / "new" / "recording.csv").read_text().splitlines()[0]
    assert header == "pressure [kPa],length [mm],force [N],cycle"


def test_mapped_headers_are_removed_and_comments_are_kept(tmp_path):
    write_case(tmp_path / "new", RECORDING, MUSCLE)
    text = (tmp_path / "new" / "muscle.toml").read_text()
    assert "columns" not in text
    assert text.startswith("# a comment\n")


def test_only_an_empty_folder_is_accepted(tmp_path):
    write_case(tmp_path / "empty", RECORDING, MUSCLE)
    before = (tmp_path / "empty" / "recording.csv").read_bytes()
    with pytest.raises(BadInput, match=r"a new case needs an empty folder; got .*empty, which has files\."):
        write_case(tmp_path / "empty", RECORDING.select(np.arange(N) < 5), MUSCLE)
    assert (tmp_path / "empty" / "recording.csv").read_bytes() == before


def test_invalid_toml_creates_no_folder(tmp_path):
    with pytest.raises(tomlkit.exceptions.ParseError):
        write_case(tmp_path / "new", RECORDING, "[muscle\n")
    assert list(tmp_path.iterdir()) == []
