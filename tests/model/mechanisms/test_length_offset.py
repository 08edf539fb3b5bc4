"""An offset of the length channel, recorded minus true."""

import jax.numpy as jnp

from pamjax.model.mechanisms.length_offset import LengthOffset
from tests.agreement import ROUNDING, agree


def test_true_length_is_the_recorded_one_minus_the_offset():
    # 201 mm − 1 mm.
    pressure, length = LengthOffset(1e-3).to_true_inputs(jnp.array([1e5]), jnp.array([0.201]), None)
    agree(length, [0.2], ROUNDING)
    agree(pressure, 1e5, ROUNDING)
