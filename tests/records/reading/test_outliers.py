"""Outliers are detected and reported; real changes of the muscle are kept."""

import numpy as np
import pytest

from pamjax.errors import InputWarning
from pamjax.records.reading.outliers import remove_outliers
from pamjax.records.recording import Recording
from tests.records.conftest import as_csv, strokes
from tests.records.reading.read_table import read_table


@pytest.mark.parametrize("name", ["pressure", "length", "force", "diameter"])
@pytest.mark.parametrize("size", [3.0, 70.0, -40.0])
def test_exactly_the_simulated_spikes_are_detected(name, size):
    columns = strokes(noise=1.0)
    spike_rows = [57, 181, 300]
    columns[name] = columns[name].copy()
    columns[name][spike_rows] *= size
    cleaned = remove_outliers(Recording.from_arrays(**columns))
    outliers = [(outlier.row - 2, outlier.column) for outlier in cleaned.outliers]
    assert outliers == [(i, name) for i in spike_rows]
    assert np.isnan(getattr(cleaned, name)[spike_rows]).all()
    assert np.isfinite(getattr(cleaned, name)).sum() == cleaned.n - 3


def test_burst_of_outliers_is_detected():
    columns = strokes(noise=1.0)
    columns["pressure"][100:102] = 4e7
    assert [outlier.row for outlier in remove_outliers(Recording.from_arrays(**columns)).outliers] == [
        102,
        103,
    ]


def test_outlier_in_the_first_sample_is_detected():
    columns = strokes(noise=1.0)
    columns["force"][0] = 1e6
    assert [outlier.row for outlier in remove_outliers(Recording.from_arrays(**columns)).outliers] == [2]


def test_outlier_is_reported_with_name_row_and_unit(write):
    columns = strokes()
    columns["pressure"][15] = 4e7
    with pytest.warns(InputWarning) as caught:
        recording = read_table(write(text=as_csv(columns)))
    text = (
        "outlier pressure 40000 kPa in row 17: ignored, because most values are between 100 kPa and 300 kPa."
    )
    assert [str(warning.message) for warning in caught] == [text]
    assert np.isnan(recording.pressure[15])


def has_no_outliers(time, pressure, length, force):
    recording = Recording.from_arrays(time=time, pressure=pressure, length=length, force=force)
    return remove_outliers(recording).outliers == ()


def test_real_changes_are_kept():
    random = np.random.default_rng(1)
    n = 400
    time = np.arange(n) * 0.1
    noise = random.standard_normal(n)
    staircase = np.repeat(np.arange(20.0), 20) * 3e4
    assert has_no_outliers(time, staircase + 400 * noise, np.full(n, 0.2), staircase / 300 + noise)
    coarse_stroke = 0.18 + 0.02 * np.tile([0.0, 1.0, 0.0, -1.0], 100)
    assert has_no_outliers(
        time, np.full(n, 2e5) + 400 * noise, coarse_stroke, 600 + 200 * np.tile([0, 1, 0, -1], 100)
    )
    two_tests = np.where(np.arange(n) < 395, 1e5, 6e5)
    assert has_no_outliers(time, two_tests, np.full(n, 0.2), two_tests / 300)
    drift = np.cumsum(noise)
    assert has_no_outliers(time, np.full(n, 2e5), np.full(n, 0.2), 500 + drift)
    heavy_tails = random.standard_t(4, n)
    assert has_no_outliers(time, np.full(n, 2e5) + 400 * heavy_tails, np.full(n, 0.2), 500 + 2 * heavy_tails)


def test_long_excursion_is_kept():
    """A threshold alone would remove these rows: the rig stayed at this value for half a second."""
    pressure = np.full(400, 1e5)
    pressure[200:205] = 1e6
    assert has_no_outliers(np.arange(400) * 0.1, pressure, np.full(400, 0.2), pressure / 300)


def test_too_many_outliers_are_kept():
    columns = strokes(noise=1.0)
    columns["force"][::20] = 1e6
    assert remove_outliers(Recording.from_arrays(**columns)).outliers == ()


def test_static_map_has_no_outliers():
    pressure = np.tile([1e5, 6e5], 20)
    recording = Recording.from_arrays(pressure=pressure, length=0.2, force=pressure / 300)
    assert remove_outliers(recording).outliers == ()
    corrupted = np.where(np.arange(40) == 7, 4e7, pressure)
    cleaned = remove_outliers(Recording.from_arrays(pressure=corrupted, length=0.2, force=pressure / 300))
    assert [outlier.row for outlier in cleaned.outliers] == [9]
