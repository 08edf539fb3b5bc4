"""Averages of neighbouring rows: groups, means, and the noise of the means."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax.records.reading.muscle_toml import Sensors
from pamjax.records.recording import Recording
from pamjax.records.row_averages import RowAverages, _find_fast_rows


def build_recording(n=900, *, diameter_interval=1, turn=None, pause=None):
    """Return a slow rise of the pressure; from a turn on it decreases, and before a pause the rig rests."""
    row = np.arange(float(n))
    time = row + np.where(row < (n if pause is None else pause), 0.0, 3600.0)
    rise = row if turn is None else turn - np.abs(row - turn)
    return Recording.from_arrays(
        pressure=1e5 + 100.0 * rise,
        length=np.full(n, 0.2),
        force=10.0 + 0.1 * rise,
        diameter=np.where(row % diameter_interval == 0, 0.02 + 1e-6 * row, np.nan),
        time=time,
    )


def average(recording, size, label=None):
    label = np.zeros(recording.n, dtype=int) if label is None else label
    return RowAverages.from_recording(recording, label, size)


@pytest.mark.parametrize("size", [3, 5, 7])
def test_each_row_belongs_to_one_group(size):
    averages = average(build_recording(turn=500, pause=300), size)
    np.testing.assert_array_equal(np.bincount(averages.group).sum(), 900)
    # Three parts have up to twenty first rows and one incomplete group each.
    assert 900 / size < averages.centres.size < 900 / size + 63


def test_means_of_a_straight_line_lie_on_it():
    averaged = average(build_recording(), 5).averaged_recording
    np.testing.assert_allclose(averaged.force, 10.0 + 0.1 * averaged.time, rtol=1e-12)
    np.testing.assert_allclose(averaged.pressure, 1e5 + 100.0 * averaged.time, rtol=1e-12)


def is_together(averages, row):
    """Return whether one group has a row and the row before it."""
    before, itself = (averages.contains(np.arange(900) == k) for k in (row - 1, row))
    return bool((before & itself).any())


@pytest.mark.parametrize("row", [301, 501, 703])
def test_no_group_extends_over_a_turn_a_pause_or_a_block(row):
    label = (np.arange(900) >= 703).astype(int)
    assert is_together(average(build_recording(), 3), row)
    assert not is_together(average(build_recording(turn=501, pause=301), 3, label), row)


@pytest.mark.parametrize("size", [3, 5, 7])
@pytest.mark.parametrize("interval", [1, 2, 3, 4, 5, 7, 10])
def test_a_channel_that_is_read_rarely_keeps_its_time(interval, size):
    recording = build_recording(diameter_interval=interval)
    averages = average(recording, size)
    is_read = np.isfinite(recording.diameter)
    time_of_diameter = averages.average(np.where(is_read, recording.time, np.nan))
    delay = time_of_diameter - averages.average(recording.time)
    assert abs(np.nanmean(delay)) < 0.1
    # Each group has a sample if there are enough; the first rows are not averaged.
    assert np.isfinite(delay).sum() >= min(is_read.sum(), averages.centres.size) - 20


def test_the_noise_of_means_is_that_of_white_noise():
    recording, sensors = build_recording(3000, diameter_interval=2), Sensors(force=2.0, diameter=1e-5)
    averages = average(recording, 5)
    scaled = averages.scale_sensors(sensors)
    noise = averages.average(2.0 * np.random.default_rng(3).standard_normal(3000))
    is_typical = averages.count("force") == 5
    assert scaled.force == pytest.approx(2.0 / np.sqrt(5))
    assert np.std(noise[is_typical]) == pytest.approx(scaled.force, rel=0.1)
    assert scaled.diameter == pytest.approx(1e-5 / np.sqrt(2.5), rel=0.15)
    assert scaled.pressure is None


def test_a_length_error_per_level_is_not_reduced():
    sensors = Sensors(length=1e-4, length_per_level=True)
    assert average(build_recording(), 5).scale_sensors(sensors).length == 1e-4


def test_means_omit_values_that_were_not_measured():
    recording = build_recording()
    force = recording.force.copy()
    force[[601, *range(300, 320)]] = np.nan
    averages = average(recording, 3)
    mean = averages.average(force)
    group = averages.group[601]
    assert np.isfinite(mean[group])
    assert mean[group] == pytest.approx(10.0 + 0.1 * averages.mean_time[group])
    assert np.isnan(mean[averages.group[302:318]]).all()


def test_equal_readings_have_exactly_that_mean():
    recording = build_recording()
    means = average(recording, 7).average(np.full(900, 500.1))
    np.testing.assert_array_equal(means, 500.1)


def test_parts_of_the_recording_remain():
    recording = build_recording(60000, pause=20000)
    averaged = average(recording, 21).averaged_recording
    assert averaged.is_run_start.sum() == recording.is_run_start.sum() == 2


@pytest.mark.parametrize("noise", [0.0, 500.0])
@pytest.mark.parametrize("period", [200.0, 2000.0])
def test_fast_strokes_have_smaller_groups(period, noise):
    row = np.arange(20000.0)
    pressure = 3e5 * (1 + np.sin(2 * np.pi * row / period)) + noise * np.sin(1e3 * row**2)
    recording = Recording.from_arrays(
        pressure=pressure, length=np.full(20000, 0.2), force=1e-3 * pressure, time=0.01 * row
    )
    averages = average(recording, 7)
    change = 3e5 * 2 * np.pi / period * np.bincount(averages.group).max()
    assert averages.centres.size <= 2 * 20000 / 7 or change < 0.3 * 6e5
    assert averages.centres.size < 0.6 * 20000


def test_one_row_without_pressure_ends_no_part():
    recording = build_recording()
    pressure = recording.pressure.copy()
    pressure[450] = np.nan
    label = np.where(np.isfinite(pressure), 0, -1)
    averages = RowAverages.from_recording(replace(recording, pressure=pressure), label, 3)
    assert averages.part[-1] == 0
    assert np.isfinite(averages.averaged_recording.pressure).sum() == averages.centres.size - 1


def test_a_group_around_a_smooth_turn_is_fast():
    """The ends of a group that is symmetric about a turn are equal, but its middle is not."""
    row = np.arange(90.0)
    pressure = 3e5 - 2e5 * np.cos(2 * np.pi * (row - 49) / 40)
    recording = Recording.from_arrays(
        pressure=pressure, length=np.full(90, 0.2), force=1e-3 * pressure, time=0.1 * row
    )
    # The group from row 45 to row 53 has its middle at the lowest pressure.
    is_fast = _find_fast_rows(recording, row % 9 == 0, share=0.05)
    assert pressure[45] == pytest.approx(pressure[53])
    assert np.ptp(pressure[45:54]) > 0.05 * 4e5
    assert is_fast[45:54].all()
    assert not _find_fast_rows(recording, row % 9 == 0, share=0.2)[45:54].any()


@pytest.mark.parametrize("size", [51, 501])
def test_noise_does_not_divide_large_groups(size):
    """The range of 501 normal values exceeds six standard deviations in half of all groups."""
    rng = np.random.default_rng(3)
    n = 40 * size
    recording = Recording.from_arrays(
        pressure=3e5 + 500.0 * rng.standard_normal(n),
        length=np.full(n, 0.2),
        force=rng.standard_normal(n),
        time=0.01 * np.arange(n),
    )
    assert not _find_fast_rows(recording, np.arange(n) % size == 0, share=0.02).any()
