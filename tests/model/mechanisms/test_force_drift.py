"""Drift of the load cell's zero, recorded minus true."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pamjax.model.mechanisms.force_drift import ForceDrift
from pamjax.parameter import list_values, replace_values
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


def test_warm_up_approaches_its_limit_with_its_time_constant():
    # D (1 − e^(−t/τ)) with t/τ = 0, ln 2 and 5 ln 2: none, half, and all but 1/32 of −8 N.
    force = drifted(warmup=-8.0, warmup_time=2.0 / np.log(2.0))
    agree(force, [100.0, 96.0, 92.25], ROUNDING)
    # Long before its time constant it is a straight line of slope D / τ, less t / (2 τ) of it.
    agree(drifted(warmup=50.0, warmup_time=1e5)[2] - 100.0, 50.0 * 1e-4 * (1 - 0.5e-4), 1e-8)


def test_drift_of_a_thick_body_grows_with_the_square_root_of_time():
    # r √t with r = 3 N/√s at 2 and 10 s.
    agree(drifted(root=3.0), 100.0 + 3.0 * np.sqrt([0.0, 2.0, 10.0]), ROUNDING)
    agree(drifted(root=-3.0)[1], 100.0 - 3.0 * 2**0.5, ROUNDING)


def test_swing_repeats_after_its_period_and_starts_at_zero():
    # T = 8 s: a quarter of a period after 2 s, and one and a quarter after 10 s.
    agree(drifted(swing_sine=4.0, period=8.0), [100.0, 104.0, 104.0], ROUNDING)
    agree(drifted(swing_cosine=4.0, period=8.0), [100.0, 104.0, 104.0], ROUNDING)
    # Half a period after 2 s, two and a half after 10 s: sin π = 0 and 1 − cos π = 2.
    agree(drifted(swing_sine=4.0, period=4.0), [100.0, 100.0, 100.0], ROUNDING)
    agree(drifted(swing_cosine=-4.0, period=4.0), [100.0, 92.0, 92.0], ROUNDING)
    # A twelfth of a period: sin 30° = 1/2 and 1 − cos 30° = 1 − √3/2.
    agree(drifted(swing_sine=4.0, period=24.0)[1], 102.0, ROUNDING)
    agree(drifted(swing_cosine=4.0, period=24.0)[1], 104.0 - 2 * 3**0.5, ROUNDING)


@pytest.mark.parametrize("time", [[40.0, 42.0, 50.0], [0.0, 0.0, 0.0]])
def test_derivatives_are_finite_at_the_first_sample_and_in_a_static_table(time):
    drift = ForceDrift(0.1, -0.01, 5.0, 30.0, 1.0, 2.0, -2.0, 90.0)
    names = list(list_values(drift))

    def read(x):
        moved = replace_values(drift, dict(zip(names, x, strict=True)))
        return moved.to_recorded_outputs(jnp.full(3, 100.0), jnp.full(3, 0.03), None, one_run(time))[0]

    at = jnp.asarray([float(v) for v in list_values(drift).values()])
    for slopes in (jax.jacfwd(read)(at), jax.jacrev(read)(at)):
        assert np.all(np.isfinite(slopes))
        agree(slopes[0], 0.0, ROUNDING, 1.0)
