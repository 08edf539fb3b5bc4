"""A dead band: the pressure that the bladder takes before it touches the braid."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pamjax.model.mechanisms.contact_pressure import ContactPressure
from tests.agreement import ROUNDING, SOLVED, agree
from tests.model.mechanisms.rubber import REST, bench, clock, shown
from tests.model.mechanisms.triangle import past


def test_dead_band_reduces_the_pressure():
    pressure, length = np.array([0.0, 5e3, 60e3, 200e3, 690e3]), np.full(5, 0.9 * REST)
    force = shown([ContactPressure(30e3)], pressure, length).force
    free = shown([], np.maximum(pressure - 30e3, 0.0), length).force
    agree(force[-2:], free[-2:], 1e-6)
    agree(force, free, 5e-3, scale=30.0)
    assert force[0] == 0


def test_derivative_of_the_dead_band_is_the_slope_in_pressure():
    pressure, length = jnp.array([5e3, 2e5, 6e5]), jnp.full(3, 0.9 * REST)
    of_band = jax.jit(jax.jacfwd(lambda p: bench(ContactPressure(p))(pressure, length, clock(3)).force))(0.0)
    by_pressure = jax.jit(jax.jacfwd(lambda p: bench()(pressure + p, length, clock(3)).force))(0.0)
    agree(of_band, -by_pressure, SOLVED)


def inside(pressure, length=0.2, **numbers):
    return ContactPressure(**numbers).pressure(None, past(length, pressure))[0]


@pytest.mark.parametrize("ratio", [0.5, 1.0, 3.0])
def test_pressure_that_reaches_the_braid(ratio):
    # P − Pc [1 + (Pc/P)⁸]^(−1/8).
    knee = (1 + ratio**-8) ** -0.125
    agree(inside(ratio * 32e3, threshold=32e3), 32e3 * (ratio - knee), 1e-11)


@pytest.mark.parametrize("pressure", [-5e3, 0.0, 1e-4])
def test_dead_band_has_no_effect_without_pressure(pressure):
    assert float(inside(pressure, threshold=32e3)) == pressure


@pytest.mark.parametrize(
    ("length", "fill", "share"),
    [
        # 1 − (c / cos θ)⁴ with cos θ = 0.6 and 0.8; a tube of its unstretched width or less counts as wider
        # by a thousandth.
        (0.20, 0.3, 1 - 1 / 16),
        (0.15, 0.4, 1 - 1 / 16),
        (0.24, 0.5, 1 - (500 / 501) ** 4),
    ],
)
def test_threshold_is_lower_for_a_narrow_braid(length, fill, share):
    # At 100 times the threshold the rounding of the corner is negligible.
    agree(inside(3.2e6, length, threshold=32e3, fill=fill), 3.2e6 - 32e3 * share, ROUNDING)
