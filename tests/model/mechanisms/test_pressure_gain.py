"""A gain error of the pressure gauge, recorded / true − 1."""

import jax.numpy as jnp

from pamjax.model.mechanisms.pressure_gain import PressureGain
from tests.agreement import ROUNDING, agree


def test_true_pressure_is_the_recorded_one_divided_by_one_plus_the_gain():
    # 125 kPa / 1.25, and −5 kPa / 1.25.
    pressure, length = PressureGain(0.25).to_true_inputs(jnp.array([125e3, -5e3]), jnp.full(2, 0.2), None)
    agree(pressure, [100e3, -4e3], ROUNDING)
    agree(length, 0.2, ROUNDING)
