"""A gain error of the load cell, recorded / true − 1."""

import jax.numpy as jnp

from pamjax.model.mechanisms.force_gain import ForceGain
from tests.agreement import ROUNDING, agree


def test_recorded_force_is_larger_than_the_true_one_by_the_gain():
    # 100 N × 1.02, and −100 N × 1.02.
    force, diameter = ForceGain(0.02).to_recorded_outputs(
        jnp.array([100.0, -100.0]), jnp.full(2, 0.03), None, None
    )
    agree(force, [102.0, -102.0], ROUNDING)
    agree(diameter, 0.03, ROUNDING)
