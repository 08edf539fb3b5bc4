"""A dead band: pressure that is spent before the braid is pressed."""

import jax
import jax.numpy as jnp
import numpy as np

from pamjax.model.mechanisms.contact_pressure import ContactPressure
from tests.agreement import SOLVED, agree
from tests.model.mechanisms.rubber import REST, bench, clock, shown


def test_dead_band_shifts_pressure_above_it_and_leaves_none_below():
    pressure, length = np.array([0.0, 5e3, 60e3, 200e3, 690e3]), np.full(5, 0.9 * REST)
    force = shown([ContactPressure(30e3)], pressure, length).force
    free = shown([], np.maximum(pressure - 30e3, 0.0), length).force
    agree(force[-2:], free[-2:], 1e-6)
    agree(force, free, 5e-3, scale=30.0)
    assert force[0] == 0


def test_dead_band_begins_as_the_slope_of_pressure():
    pressure, length = jnp.array([5e3, 2e5, 6e5]), jnp.full(3, 0.9 * REST)
    of_band = jax.jit(jax.jacfwd(lambda p: bench(ContactPressure(p))(pressure, length, clock(3)).force))(0.0)
    by_pressure = jax.jit(jax.jacfwd(lambda p: bench()(pressure + p, length, clock(3)).force))(0.0)
    agree(of_band, -by_pressure, SOLVED)
