"""Identities of the triangle relation for all parameters."""

import jax
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pamjax.model import braid
from tests.agreement import ROUNDING, agree

work_of_length = jax.jit(jax.grad(braid.volume))
work_of_thread = jax.jit(jax.grad(braid.volume, argnums=1))

turns = st.floats(0.05, 200)
length = st.floats(1e-3, 20)
longer = st.floats(1.01, 5)
pressure = st.floats(1.0, 1e7) | st.floats(-1e5, -1.0)


@given(pressure, length, longer, turns)
def test_gaylord_force_agrees_with_the_trigonometric_form(p, l, ratio, n):
    b = ratio * l
    theta = braid.angle(l, b)
    radius = 0.5 * braid.diameter(l, b, n)
    trigonometric = p * np.pi * radius**2 * (2 * np.tan(theta) ** 2 - 1)
    agree(braid.gaylord_force(p, l, b, n), trigonometric, ROUNDING, scale=abs(p) * b**2 / n**2)


@given(pressure, length, longer, turns)
def test_gaylord_force_is_the_work_of_the_volume(p, l, ratio, n):
    b = ratio * l
    agree(
        braid.gaylord_force(p, l, b, n),
        -p * work_of_length(l, b, n),
        ROUNDING,
        scale=abs(p) * b**2 / n**2,
    )


@given(pressure, length, longer, turns)
def test_hoop_pull_is_the_work_of_the_volume(p, l, ratio, n):
    b = ratio * l
    agree(braid.hoop_pull(p, l, b, n), p * work_of_thread(l, b, n), ROUNDING)


@given(pressure, length, longer, turns)
def test_hoop_pull_balances_the_two_forces_of_the_thread(p, l, ratio, n):
    """Eqs. 2 and 3 without the bladder, resolved by the braid angle."""
    b = ratio * l
    theta, radius = braid.angle(l, b), 0.5 * braid.diameter(l, b, n)
    tension = braid.hoop_pull(p, l, b, n)
    hoop = n * tension * np.cos(theta)
    agree(hoop, p * radius * l, ROUNDING)
    axial = tension * np.sin(theta) - p * np.pi * radius**2
    agree(axial, braid.gaylord_force(p, l, b, n), ROUNDING, scale=abs(p) * b**2 / n**2)


@given(length, longer, turns)
def test_thread_and_diameter_are_inverse(l, ratio, n):
    b = ratio * l
    agree(braid.thread_from_diameter(l, braid.diameter(l, b, n), n), b, ROUNDING)
    agree(braid.radius_squared(l, b, n), (0.5 * braid.diameter(l, b, n)) ** 2, ROUNDING)
    agree(braid.volume(l, b, n), np.pi * braid.radius_squared(l, b, n) * l, ROUNDING)


@given(length, st.floats(1e-4, 5), st.floats(0.05, 1.55))
def test_angle_conversion_is_invertible(l, d, theta):
    b, n = braid.from_angle(l, d, theta)
    agree(braid.angle(l, b), theta, 1e4 * ROUNDING)  # asin near 90° loses what cos needs
    agree(braid.thread_from_diameter(l, d, n), b, ROUNDING)


def test_force_vanishes_at_the_magic_angle():
    theta = np.arctan(1 / np.sqrt(2))
    assert np.degrees(theta) == pytest.approx(35.264, abs=1e-3)
    agree(braid.gaylord_force(7e5, np.sin(theta), 1.0, 1.0), 0.0, ROUNDING, scale=7e5)


def test_functions_broadcast():
    shape = (np.zeros((3, 1)) + 0.2, np.full(4, 0.25))
    for function in (braid.diameter, braid.volume):
        assert function(*shape, 1.09).shape == (3, 4)
    assert braid.gaylord_force(1e5, *shape, 1.09).shape == (3, 4)


def test_too_short_thread_has_no_diameter():
    assert np.isnan(braid.diameter(0.3, 0.25, 1.0))
    assert braid.radius_squared(0.3, 0.25, 1.0) < 0
