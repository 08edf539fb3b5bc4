"""An offset of the pressure gauge, recorded minus true."""

import jax.numpy as jnp

from pamjax.model.mechanisms.pressure_offset import PressureOffset
from tests.agreement import ROUNDING, agree


def test_true_pressure_is_the_recorded_one_minus_the_offset():
    # 103 kPa − 3 kPa; a vented gauge reads the offset itself.
    pressure, length = PressureOffset(3e3).to_true_inputs(jnp.array([103e3, 3e3]), jnp.full(2, 0.2), None)
    agree(pressure, [100e3, 0.0], ROUNDING, 1.0)
    agree(length, 0.2, ROUNDING)
