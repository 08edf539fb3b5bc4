"""Drifts, friction and damping in other forms have the values and limits that their docstrings state."""

import math

import numpy as np
import pytest

from pamjax.benchmark.other_forms import friction_forms, sensor_forms
from tests.agreement import ROUNDING, agree

TIME = 5.0 + np.linspace(0.0, 100.0, 401)


def test_warm_up_reaches_63_percent_after_its_time_constant():
    course = sensor_forms.compute_warm_up(TIME, 25.0)
    agree(course[[0, 100]], [0.0, 1 - math.exp(-1)], ROUNDING)


def test_square_root_has_half_of_its_drift_after_a_quarter_of_the_time():
    agree(sensor_forms.compute_square_root(TIME)[[0, 100, -1]], [0.0, 0.5, 1.0], ROUNDING)


def test_slow_sine_starts_at_zero_and_repeats():
    course = sensor_forms.compute_slow_sine(TIME, 50.0, 0.7)
    agree(course[[0, 200]], [0.0, 0.0], ROUNDING, scale=1.0)
    agree(course[100], -2 * math.sin(0.7), ROUNDING)


def test_wander_starts_at_zero_and_is_smoother_than_its_walk():
    course = sensor_forms.draw_wander(TIME, 0.1, np.random.default_rng(3))
    assert course[0] == 0.0
    assert np.mean(course**2) == pytest.approx(1.0)
    assert np.abs(np.diff(course)).max() < 0.05


def test_dahl_friction_forgets_a_reversal_exponentially():
    position = np.r_[np.linspace(0, 1.0, 101), np.linspace(1.0, 0.9, 11)[1:]]
    state = friction_forms.slide_dahl(position, 0.1)
    assert state[0] == 0.0
    agree(state[10], 1 - math.exp(-1), ROUNDING)
    # From +1, a tenth backwards: −1 + (1 + z) e^(−1).
    agree(state[-1], -1 + (1 + state[100]) * math.exp(-1), ROUNDING)


def test_friction_weakens_with_speed_to_its_share():
    factor = friction_forms.weaken_with_speed(np.array([0.0, -2e-3, 1.0]), 2e-3, 0.4)
    agree(factor, [1.0, 0.4 + 0.6 * math.exp(-1), 0.4], ROUNDING)


def test_one_sided_friction_acts_in_one_direction():
    state = np.array([-0.5, 0.0, 0.8])
    agree(friction_forms.keep_one_direction(state, 1), [0.0, 0.0, 0.8], 0)
    agree(friction_forms.keep_one_direction(state, -1), [-0.5, 0.0, 0.0], 0)


def test_power_of_pressure_is_one_at_its_reference():
    pressures = np.array([-1e3, 0.0, 2e5, 4e5])
    agree(friction_forms.raise_to_power(pressures, 4e5, 1.5), [0.0, 0.0, 0.5**1.5, 1.0], ROUNDING)


def test_eyring_damping_is_linear_at_low_and_logarithmic_at_high_speed():
    agree(friction_forms.damp_by_eyring(np.array([1e-9]), 1e-3), [1e-6], 1e-9)
    agree(friction_forms.damp_by_eyring(np.array([1.0]), 1e-6), [math.log(2e6)], 1e-9)


def test_directional_damping_is_weaker_in_the_other_direction():
    velocity = np.array([-2e-3, 2e-3])
    agree(friction_forms.damp_by_direction(velocity, 1e-3, 0.25, 1), [-0.5, 2.0], ROUNDING)
    agree(friction_forms.damp_by_direction(velocity, 1e-3, 0.25, -1), [-2.0, 0.5], ROUNDING)
