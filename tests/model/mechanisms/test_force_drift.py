"""Drift of the load cell's zero, recorded minus true."""

import jax.numpy as jnp
import numpy as np

from pamjax.model.mechanisms.force_drift import ForceDrift
from tests.agreement import ROUNDING, agree
from tests.model.mechanisms.triangle import one_run


def drifted(**numbers):
    """Return the recorded force of a muscle with 100 N, at 0, 2 and 10 s of the recording."""
    force, diameter = ForceDrift(**numbers).to_recorded_outputs(
        jnp.full(3, 100.0), jnp.full(3, 0.03), None, one_run([40.0, 42.0, 50.0])
    )
    agree(diameter, 0.03, ROUNDING)
    return np.asarray(force)


def test_recorded_force_is_the_true_one_plus_the_drift_since_the_first_sample():
    # a t with a = 0.5 N/s; b t² with b = −0.02 N/s².
    agree(drifted(rate=0.5), [100.0, 101.0, 105.0], ROUNDING)
    agree(drifted(bend=-0.02), [100.0, 99.92, 98.0], ROUNDING)
    agree(drifted(rate=0.5, bend=-0.02), [100.0, 100.92, 103.0], ROUNDING)
