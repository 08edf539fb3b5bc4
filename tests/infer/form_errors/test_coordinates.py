"""Variables of form errors: constants of one recording scale the rows of another."""

from dataclasses import replace

import numpy as np

from pamjax.infer.form_errors.coordinates import Coordinates, CoordinateScales
from pamjax.records.recording import Recording
from tests.agreement import ROUNDING, agree

N = 60
PHASE = np.linspace(0, 4 * np.pi, N)
LENGTH = 0.19 + 0.01 * np.cos(PHASE)
RATE = -0.01 * np.sin(PHASE)
RECORDING = Recording.from_arrays(
    time=np.arange(float(N)),
    pressure=np.repeat([1e5, 2e5, 4e5], N // 3),
    length=LENGTH,
    force=np.linspace(100.0, 900.0, N),
)
ALL = np.ones(N, dtype=bool)
#: An effect that acts at the two lower pressures only.
EFFECT = np.where(RECORDING.pressure < 3e5, 10.0, 0.0)


def scale(rows, limits):
    return limits.scale_rows(RECORDING.pressure[rows], LENGTH[rows], RECORDING.force[rows], RATE[rows])


def test_rows_of_the_recording_have_its_coordinates():
    limits = CoordinateScales.from_recording(RECORDING, ALL, RATE)
    coordinates, rows = Coordinates.from_recording(RECORDING, ALL, RATE), slice(7, 19)
    scaled = scale(rows, limits)
    for name in ("pressure", "length", "force", "direction", "speed"):
        agree(getattr(scaled, name), getattr(coordinates, name)[rows], ROUNDING)


def test_limits_where_an_effect_acts_are_those_of_the_rescaled_coordinates():
    limits = CoordinateScales.from_recording(RECORDING, ALL, RATE)
    local = Coordinates.from_recording(RECORDING, ALL, RATE).rescale(EFFECT)
    restricted = limits.restrict(RECORDING.pressure, LENGTH, EFFECT)
    assert restricted.pressure == (1e5, 2e5)
    scaled = scale(slice(None), restricted)
    agree(scaled.pressure, local.pressure, ROUNDING, 1.0)
    agree(scaled.length, local.length, ROUNDING, 1.0)
    assert limits.restrict(RECORDING.pressure, LENGTH, np.zeros(N)) is limits


def test_one_pressure_has_one_value():
    # A difference of rounding size between equal limits would become the other limit.
    limits = CoordinateScales.from_recording(RECORDING, ALL, RATE)
    lone = np.where(RECORDING.pressure == 2e5, 10.0, 0.0)
    restricted = limits.restrict(RECORDING.pressure, LENGTH, lone)
    rows = RECORDING.pressure == 2e5
    agree(scale(rows, restricted).pressure, -1.0, ROUNDING)


def test_a_value_above_equal_limits_counts_as_the_limit():
    restricted = CoordinateScales.from_recording(RECORDING, ALL, RATE)
    restricted = replace(restricted, pressure=(3e5, 3e5))
    scaled = restricted.scale_rows(*(np.array([v, v + 1e-6]) for v in (3e5, 0.2, 10.0, 0.0)))
    agree(scaled.pressure, -1.0, ROUNDING)


def test_missing_values_have_a_coordinate_and_change_no_limit():
    pressure = np.where(np.arange(RECORDING.n) == 1, np.nan, RECORDING.pressure)
    limits = CoordinateScales.from_recording(RECORDING, ALL, RATE)
    restricted = limits.restrict(pressure, LENGTH, np.ones(RECORDING.n))
    assert np.all(np.isfinite([*restricted.pressure, *restricted.length]))
    scaled = limits.scale_rows(pressure, LENGTH, RECORDING.force, RATE)
    assert np.all(np.isfinite(scaled.pressure))
    others = np.arange(RECORDING.n) != 1
    agree(scaled.pressure[others], scale(ALL, limits).pressure[others], ROUNDING, 1.0)


def test_values_outside_the_recording_count_as_its_limits():
    limits = CoordinateScales.from_recording(RECORDING, ALL, RATE)
    outside = limits.scale_rows(
        np.array([9e5, 0.0]), np.array([0.3, 0.1]), np.array([1e4, -1e4]), np.array([10.0, 0.0])
    )
    for values in (outside.pressure, outside.length, outside.force):
        agree(values, [1.0, -1.0], ROUNDING)
    agree(outside.speed, limits.speed[::-1], ROUNDING)
    faster = replace(limits, speed=(-np.inf, np.inf)).scale_rows(*np.full((4, 1), 10.0))
    assert faster.speed[0] > limits.speed[1] + 1
