"""Fixed lengths are replaced by their means; moving lengths are unchanged."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax.records.fixed_length import average_fixed_lengths, find_rest_samples
from pamjax.records.recording import Recording
from tests.infer.made import made

ROWS_PER_LENGTH, NOISE = 120, 2e-5
LENGTHS = 0.2357 - 0.01 * np.arange(5)


def ramps(motion=0.0, noise=NOISE, travel=0, **sensors):
    """Return pressure ramps at five lengths, with noise, motion within each visit, and rows between them."""
    n = ROWS_PER_LENGTH * LENGTHS.size
    pressure = 5e5 * np.tile(np.abs(np.linspace(-1, 1, ROWS_PER_LENGTH)), LENGTHS.size)
    rng = np.random.default_rng(4)
    length = np.repeat(LENGTHS, ROWS_PER_LENGTH)
    for k in range(ROWS_PER_LENGTH, n, ROWS_PER_LENGTH) if travel else ():
        length[k - travel : k] = np.linspace(length[k - 1], length[k], travel + 2)[1:-1]
    recording = Recording.from_arrays(
        pressure=pressure,
        length=length + noise * rng.standard_normal(n) + motion * pressure / 5e5,
        force=1e-3 * pressure, diameter=np.full(n, np.nan), time=0.1 * np.arange(n),
    )  # fmt: skip
    case = made("elastic")
    stated_sensors = replace(case.muscle_toml.sensors, **{"length": NOISE} | sensors)
    return replace(case, recording=recording, muscle_toml=replace(case.muscle_toml, sensors=stated_sensors))


def test_fixed_length_is_its_mean_with_the_noise_of_a_mean():
    case = average_fixed_lengths(ramps())
    assert np.unique(case.recording.length).size == LENGTHS.size
    assert np.abs(np.unique(case.recording.length) - np.sort(LENGTHS)).max() < 4 * NOISE / np.sqrt(
        ROWS_PER_LENGTH
    )
    assert case.muscle_toml.sensors.length == pytest.approx(NOISE / np.sqrt(ROWS_PER_LENGTH))
    # All samples at one length have the error of their mean.
    assert case.muscle_toml.sensors.length_per_level


def test_moving_length_and_ruler_readings_are_unchanged():
    for case in (ramps(motion=3 * NOISE), ramps(noise=0.0), ramps(length_per_level=True)):
        assert average_fixed_lengths(case) is case
    stroke = made("elastic")
    assert average_fixed_lengths(stroke) is stroke


def test_unstated_sensor_noise_stays_unstated():
    case = average_fixed_lengths(ramps(length=None))
    assert np.unique(case.recording.length).size == LENGTHS.size
    assert case.muscle_toml.sensors.length is None


@pytest.mark.parametrize("travel", [1, 2, 5])
def test_rows_between_lengths_are_not_averaged(travel):
    before = ramps(travel=travel)
    after = average_fixed_lengths(before).recording.length
    is_unchanged = after == before.recording.length
    is_transition = np.abs(before.recording.length - np.repeat(LENGTHS, ROWS_PER_LENGTH)) > 10 * NOISE
    assert is_transition.sum() == travel * (LENGTHS.size - 1)
    assert np.all(is_unchanged[is_transition])
    assert np.mean(is_unchanged[~is_transition]) < 0.01
    assert np.abs(after - np.repeat(LENGTHS, ROWS_PER_LENGTH))[~is_transition].max() < 4 * NOISE / np.sqrt(
        ROWS_PER_LENGTH
    )


def test_noise_is_averaged_and_motion_with_pressure_is_not():
    rng = np.random.default_rng(5)
    motion = np.abs(np.linspace(-1, 1, ROWS_PER_LENGTH))
    noise = rng.standard_normal((200, ROWS_PER_LENGTH))
    assert np.mean([find_rest_samples(sample).any() for sample in noise]) > 0.97
    assert np.mean([find_rest_samples(sample + 3 * motion).any() for sample in noise]) < 0.05
    assert not find_rest_samples(np.arange(ROWS_PER_LENGTH)).any()
    assert not find_rest_samples(noise[0, :10]).any()
