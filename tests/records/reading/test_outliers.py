"""Garbled cells are found and told; what a muscle does is left in."""

import numpy as np
import pytest

from pamjax.errors import InputWarning
from pamjax.records.reading.outliers import remove_outliers
from pamjax.records.reading.table import read_table
from pamjax.records.recording import Recording
from tests.records.conftest import as_csv, strokes


def recorded(**changed):
    return Recording.from_arrays(**{**strokes(noise=1.0), **changed})


@pytest.mark.parametrize("name", ["pressure", "length", "force", "diameter"])
@pytest.mark.parametrize("size", [3.0, 70.0, -40.0])
def test_planted_spikes_are_found_and_nothing_else(name, size):
    columns = strokes(noise=1.0)
    planted = [57, 181, 300]
    columns[name] = columns[name].copy()
    columns[name][planted] *= size
    found = remove_outliers(Recording.from_arrays(**columns))
    assert [(aside.row - 2, aside.column) for aside in found.outliers] == [(i, name) for i in planted]
    assert np.isnan(getattr(found, name)[planted]).all()
    assert np.isfinite(getattr(found, name)).sum() == found.n - 3


def test_a_burst_of_garble_is_found():
    columns = strokes(noise=1.0)
    columns["pressure"][100:102] = 4e7
    assert [aside.row for aside in remove_outliers(Recording.from_arrays(**columns)).outliers] == [102, 103]


def test_the_first_sample_may_be_garbled():
    columns = strokes(noise=1.0)
    columns["force"][0] = 1e6
    assert [aside.row for aside in remove_outliers(Recording.from_arrays(**columns)).outliers] == [2]


def test_a_garbled_cell_is_told_by_name_row_and_unit(write):
    columns = strokes()
    columns["pressure"][15] = 4e7
    with pytest.warns(InputWarning) as seen:
        recording = read_table(write(whole=as_csv(columns)))
    text = "pressure 40000 kPa in row 17 was set aside: nearly all others lie between 100 kPa and 300 kPa."
    assert [str(one.message) for one in seen] == [text]
    assert np.isnan(recording.pressure[15])


def quiet(time, pressure, length, force):
    recording = Recording.from_arrays(time=time, pressure=pressure, length=length, force=force)
    return remove_outliers(recording).outliers == ()


def test_what_a_rig_does_is_left_in():
    random = np.random.default_rng(1)
    n = 400
    time = np.arange(n) * 0.1
    noise = random.standard_normal(n)
    staircase = np.repeat(np.arange(20.0), 20) * 3e4
    assert quiet(time, staircase + 400 * noise, np.full(n, 0.2), staircase / 300 + noise)
    coarse_stroke = 0.18 + 0.02 * np.tile([0.0, 1.0, 0.0, -1.0], 100)
    assert quiet(time, np.full(n, 2e5) + 400 * noise, coarse_stroke, 600 + 200 * np.tile([0, 1, 0, -1], 100))
    two_tests = np.where(np.arange(n) < 395, 1e5, 6e5)
    assert quiet(time, two_tests, np.full(n, 0.2), two_tests / 300)
    drift = np.cumsum(noise)
    assert quiet(time, np.full(n, 2e5), np.full(n, 0.2), 500 + drift)
    heavy_tails = random.standard_t(4, n)
    assert quiet(time, np.full(n, 2e5) + 400 * heavy_tails, np.full(n, 0.2), 500 + 2 * heavy_tails)


def test_a_stay_far_away_is_no_garble():
    """A threshold alone would take these: the rig was really there for half a second."""
    pressure = np.full(400, 1e5)
    pressure[200:205] = 1e6
    assert quiet(np.arange(400) * 0.1, pressure, np.full(400, 0.2), pressure / 300)


def test_too_many_are_no_accident():
    columns = strokes(noise=1.0)
    columns["force"][::20] = 1e6
    assert remove_outliers(Recording.from_arrays(**columns)).outliers == ()


def test_a_static_map_has_no_neighbours():
    pressure = np.tile([1e5, 6e5], 20)
    recording = Recording.from_arrays(pressure=pressure, length=0.2, force=pressure / 300)
    assert remove_outliers(recording).outliers == ()
    garbled = np.where(np.arange(40) == 7, 4e7, pressure)
    found = remove_outliers(Recording.from_arrays(pressure=garbled, length=0.2, force=pressure / 300))
    assert [aside.row for aside in found.outliers] == [9]
