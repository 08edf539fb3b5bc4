"""An offset of the load cell, recorded minus true."""

import jax.numpy as jnp

from pamjax.model.mechanisms.force_offset import ForceOffset
from tests.agreement import ROUNDING, agree


def test_recorded_force_is_the_true_one_plus_the_offset():
    # 100 N + 3 N, and −100 N + 3 N.
    force, diameter = ForceOffset(3.0).to_recorded_outputs(
        jnp.array([100.0, -100.0]), jnp.full(2, 0.03), None, None
    )
    agree(force, [103.0, -97.0], ROUNDING)
    agree(diameter, 0.03, ROUNDING)
