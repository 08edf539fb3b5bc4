"""An outer diameter: larger than the braid by an offset, which decreases under pressure."""

import jax.numpy as jnp
import numpy as np
import pytest

from pamjax.model.bench import record_bench
from pamjax.model.history import build_time_history
from pamjax.model.mechanism import Past
from pamjax.model.mechanisms.diameter_offset import DiameterOffset
from pamjax.model.state import State
from tests.agreement import ROUNDING, agree
from tests.model.mechanisms.triangle import past
from tests.model.mechanisms.typical import LENGTH, bench

PRESSURE = np.array([-2e3, 0.0, 5e4, 1e5, 4e5, 7e5])
AT = LENGTH * (1 - np.array([0.0, 0.1, 0.2, 0.05, 0.3, 0.0]))
STILL = build_time_history(None, np.arange(AT.size) == 0)


def seen(*numbers):
    reading = record_bench(bench(DiameterOffset(*numbers)), PRESSURE, AT, STILL)
    return np.asarray(reading.diameter), np.asarray(reading.force)


def test_outer_diameter_is_larger_by_the_offset():
    (outer, force), (bare, same) = seen(0.6e-3), seen()
    agree(outer - bare, 0.6e-3, 1e-10)
    agree(force, same, ROUNDING)


def test_yarns_are_half_compressed_at_the_half_pressure():
    (outer, force), (bare, same) = seen(0.6e-3, 0.1e-3, 1e5), seen()
    flatter = 0.1e-3 * np.array([0.0, 0.0, 1 / 3, 1 / 2, 4 / 5, 7 / 8])
    agree(outer - bare, 0.6e-3 - flatter, 1e-10)
    agree(force, same, ROUNDING)
    # Proportionality to pressure would be another law.
    with pytest.raises(AssertionError):
        agree(outer - bare, 0.6e-3 - 0.1e-3 * PRESSURE.clip(0) / 8e5, 1e-3)


def test_recorded_diameter_is_the_true_one_plus_the_offset_less_the_compaction():
    # D + d − c P / (P + Ph) = 30 + 0.6 − 0.1 × (3/4, 0, 0) mm at P = 3 Ph, 0 and under suction.
    pressure = np.array([6e5, 0.0, -1e4])
    sensor, went = DiameterOffset(0.6e-3, 0.1e-3, 2e5), past(np.full(3, 0.2), pressure)
    force, diameter = sensor.to_recorded_outputs(jnp.full(3, 100.0), jnp.full(3, 0.03), went, None)
    agree(diameter, [30.525e-3, 30.6e-3, 30.6e-3], ROUNDING)
    agree(force, 100.0, ROUNDING)


def record_coat(thinning, theta):
    """Return the offset of a cylinder with a coat of 1 mm at 54.7°, at a braid angle (rad)."""
    thread, turns = 0.3, 1.5
    length, diameter = thread * np.sin(theta), thread * np.cos(theta) / (np.pi * turns)
    state = State(length, thread, turns, diameter / 2, diameter, 1.0)
    went = Past(state, np.zeros(1), np.zeros(1), np.zeros(1))
    sensor = DiameterOffset(1e-3, thinning=thinning)
    _, recorded = sensor.to_recorded_outputs(jnp.zeros(1), jnp.asarray([diameter]), went, None)
    return float(recorded[0]) - diameter


def test_a_coat_of_constant_length_conserves_its_cross_section():
    # Thickness × diameter is constant. D ∝ cos θ, and cos 54.7° = 1/√3.
    for degrees in (54.7356103, 60.0, 75.0):
        theta = np.deg2rad(degrees)
        agree(record_coat(1.0, theta), 1e-3 / (np.sqrt(3) * np.cos(theta)), 1e-7)
    # cos 60° = 1/2: the coat of a third of the power is (2/√3)^(1/3) times as thick.
    agree(record_coat(1 / 3, np.deg2rad(60)), 1e-3 * (2 / np.sqrt(3)) ** (1 / 3), 1e-9)


def test_a_coat_of_a_straight_muscle_has_a_finite_thickness():
    agree(record_coat(1.0, np.pi / 2), 4e-3, 1e-9)
