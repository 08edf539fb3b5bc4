"""A held length is one length; a length that moves is left as it was recorded."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax.records.held import held
from pamjax.records.recording import Recording
from tests.infer.made import made

STAY, NOISE = 120, 2e-5
LENGTHS = 0.2357 - 0.01 * np.arange(5)


def ramps(moved=0.0, noise=NOISE, **sensors):
    """Fillings at five lengths, with noise on each, and as much motion within each stay."""
    n = STAY * LENGTHS.size
    pressure = 5e5 * np.tile(np.abs(np.linspace(-1, 1, STAY)), LENGTHS.size)
    rng = np.random.default_rng(4)
    recording = Recording.from_arrays(
        pressure=pressure,
        length=np.repeat(LENGTHS, STAY) + noise * rng.standard_normal(n) + moved * pressure / 5e5,
        force=1e-3 * pressure, diameter=np.full(n, np.nan), time=0.1 * np.arange(n),
    )  # fmt: skip
    case = made("elastic")
    stated = replace(case.entry.sensors, **{"length": NOISE} | sensors)
    return replace(case, recording=recording, entry=replace(case.entry, sensors=stated))


def test_a_held_length_is_its_mean_and_its_noise_that_of_a_mean():
    case = held(ramps())
    assert np.unique(case.recording.length).size == LENGTHS.size
    assert np.abs(np.unique(case.recording.length) - np.sort(LENGTHS)).max() < 4 * NOISE / np.sqrt(STAY)
    assert case.entry.sensors.length == pytest.approx(NOISE / np.sqrt(STAY))


def test_nothing_is_changed_where_the_length_moves_or_is_a_ruler_read_once():
    for case in (ramps(moved=8 * NOISE), ramps(noise=0.0), ramps(length_per_setting=True)):
        assert held(case) is case
    stroke = made("elastic")
    assert held(stroke) is stroke


def test_what_nobody_stated_of_the_sensor_stays_unstated():
    case = held(ramps(length=None))
    assert np.unique(case.recording.length).size == LENGTHS.size
    assert case.entry.sensors.length is None
