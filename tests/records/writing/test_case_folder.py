"""What is written is read again, to what a sensor could tell."""

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
# a comment stays
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


def test_a_recording_comes_back(tmp_path):
    write_case(tmp_path / "new", RECORDING, MUSCLE)
    again = read_case(tmp_path / "new").recording
    units = {"time": "s", "pressure": "kPa", "length": "mm", "force": "N", "diameter": "mm"}
    for name, digits in COLUMN_DECIMALS.items():
        half = 0.5 * 10.0**-digits * compute_si_factor(units[name])
        np.testing.assert_allclose(getattr(again, name), getattr(RECORDING, name), rtol=0, atol=1.001 * half)
    np.testing.assert_array_equal(again.cycle, RECORDING.cycle)
    np.testing.assert_array_equal(again.row, RECORDING.row)


def test_what_was_not_measured_has_no_column(tmp_path):
    bare = dataclasses.replace(RECORDING, time=None, diameter=np.full(N, np.nan))
    write_case(tmp_path / "new", bare, MUSCLE)
    header = (tmp_path / "new" / "recording.csv").read_text().splitlines()[0]
    assert header == "pressure [kPa],length [mm],force [N],cycle"


def test_foreign_headers_are_dropped_and_comments_stay(tmp_path):
    write_case(tmp_path / "new", RECORDING, MUSCLE)
    text = (tmp_path / "new" / "muscle.toml").read_text()
    assert "columns" not in text
    assert text.startswith("# a comment stays\n")


def test_an_empty_folder_is_taken_a_full_one_refused(tmp_path):
    write_case(tmp_path / "empty", RECORDING, MUSCLE)
    before = (tmp_path / "empty" / "recording.csv").read_bytes()
    with pytest.raises(BadInput, match=r"a new case needs an empty folder; got .*empty, which is not\."):
        write_case(tmp_path / "empty", RECORDING.select(np.arange(N) < 5), MUSCLE)
    assert (tmp_path / "empty" / "recording.csv").read_bytes() == before


def test_a_text_that_is_no_toml_leaves_no_folder(tmp_path):
    with pytest.raises(tomlkit.exceptions.ParseError):
        write_case(tmp_path / "new", RECORDING, "[muscle\n")
    assert list(tmp_path.iterdir()) == []
