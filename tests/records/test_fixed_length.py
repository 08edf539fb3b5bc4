"""A held length is one length; a length that moves is left as it was recorded."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax.records.fixed_length import average_fixed_lengths, find_rest_samples
from pamjax.records.recording import Recording
from tests.infer.made import made

STAY, NOISE = 120, 2e-5
LENGTHS = 0.2357 - 0.01 * np.arange(5)


def ramps(moved=0.0, noise=NOISE, travel=0, **sensors):
    """Fillings at five lengths, with noise on each, as much motion within each stay, and rows on the way."""
    n = STAY * LENGTHS.size
    pressure = 5e5 * np.tile(np.abs(np.linspace(-1, 1, STAY)), LENGTHS.size)
    rng = np.random.default_rng(4)
    length = np.repeat(LENGTHS, STAY)
    for k in range(STAY, n, STAY) if travel else ():
        length[k - travel : k] = np.linspace(length[k - 1], length[k], travel + 2)[1:-1]
    recording = Recording.from_arrays(
        pressure=pressure,
        length=length + noise * rng.standard_normal(n) + moved * pressure / 5e5,
        force=1e-3 * pressure, diameter=np.full(n, np.nan), time=0.1 * np.arange(n),
    )  # fmt: skip
    case = made("elastic")
    stated = replace(case.entry.sensors, **{"length": NOISE} | sensors)
    return replace(case, recording=recording, entry=replace(case.entry, sensors=stated))


def test_a_held_length_is_its_mean_and_its_noise_that_of_a_mean():
    case = average_fixed_lengths(ramps())
    assert np.unique(case.recording.length).size == LENGTHS.size
    assert np.abs(np.unique(case.recording.length) - np.sort(LENGTHS)).max() < 4 * NOISE / np.sqrt(STAY)
    assert case.entry.sensors.length == pytest.approx(NOISE / np.sqrt(STAY))
    # All samples of a visit have its mean's error.
    assert case.entry.sensors.length_per_setting


def test_nothing_is_changed_where_the_length_moves_or_is_a_ruler_read_once():
    for case in (ramps(moved=3 * NOISE), ramps(noise=0.0), ramps(length_per_setting=True)):
        assert average_fixed_lengths(case) is case
    stroke = made("elastic")
    assert average_fixed_lengths(stroke) is stroke


def test_what_nobody_stated_of_the_sensor_stays_unstated():
    case = average_fixed_lengths(ramps(length=None))
    assert np.unique(case.recording.length).size == LENGTHS.size
    assert case.entry.sensors.length is None


@pytest.mark.parametrize("travel", [1, 2, 5])
def test_what_is_on_its_way_to_the_next_length_is_no_part_of_a_visit(travel):
    before = ramps(travel=travel)
    after = average_fixed_lengths(before).recording.length
    same = after == before.recording.length
    on_the_way = np.abs(before.recording.length - np.repeat(LENGTHS, STAY)) > 10 * NOISE
    assert on_the_way.sum() == travel * (LENGTHS.size - 1)
    assert np.all(same[on_the_way])
    assert np.mean(same[~on_the_way]) < 0.01
    assert np.abs(after - np.repeat(LENGTHS, STAY))[~on_the_way].max() < 4 * NOISE / np.sqrt(STAY)


def test_noise_rests_and_what_breathes_with_pressure_does_not():
    rng = np.random.default_rng(5)
    breath = np.abs(np.linspace(-1, 1, STAY))
    noise = rng.standard_normal((200, STAY))
    assert np.mean([find_rest_samples(one).any() for one in noise]) > 0.97
    assert np.mean([find_rest_samples(one + 3 * breath).any() for one in noise]) < 0.05
    assert not find_rest_samples(np.arange(STAY)).any()
    assert not find_rest_samples(noise[0, :10]).any()
