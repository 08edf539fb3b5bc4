"""Cones and Tondu's factor: their closed forms, and their difference from the net of the ends."""

import jax
import numpy as np
import pytest

from pamjax.errors import BadInput
from pamjax.model import braid
from pamjax.model.bench import record_bench
from pamjax.model.history import build_time_history
from pamjax.model.mechanisms.contraction_factor import ContractionFactor
from pamjax.model.mechanisms.end_cones import EndCones
from pamjax.model.mechanisms.end_taper import EndTaper
from pamjax.model.net import solve_net
from pamjax.model.registry import check_exclusive_pairs
from pamjax.model.state import Cylinder
from tests.agreement import ROUNDING, SOLVED, agree
from tests.model.mechanisms.test_end_taper import rings
from tests.model.mechanisms.typical import LENGTH, PRESSURE, THREAD, TURNS, bench

CONTRACTION = np.array([0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.37])
AT = LENGTH * (1 - CONTRACTION)
RADIUS = np.sqrt(THREAD**2 - AT**2) / (2 * np.pi * TURNS)
FORCE = PRESSURE * (3 * AT**2 - THREAD**2) / (4 * np.pi * TURNS**2)
STILL = build_time_history(None, np.arange(AT.size) == 0)


def shown(mechanism):
    reading = record_bench(bench(mechanism), np.full(AT.size, PRESSURE), AT, STILL)
    return np.asarray(reading.force), np.asarray(reading.diameter)


@pytest.mark.parametrize("fitting", [0.011, RADIUS[0], 0.0135])
def test_force_and_diameter_of_cones_have_the_closed_form(fitting):
    """Fittings narrower than the muscle, equal, and wider: a smooth function."""
    force, mean = shown(EndCones(0.3, fitting))
    agree(force, FORCE - 0.3 * PRESSURE * (RADIUS - fitting) * AT / (np.pi * TURNS**2), SOLVED)
    agree(mean, 2 * RADIUS - 0.6 * (RADIUS - fitting) ** 2 / AT, ROUNDING)


def test_volume_of_cones_agrees_with_frusta():
    """Reference: slices of a cylinder between two frusta, summed along the axis."""
    state = Cylinder()(AT[5], THREAD, TURNS)
    high, fitting = 0.8 * (RADIUS[5] - 0.012), 0.012
    z = np.linspace(0, high, 2001)
    profile = fitting + (RADIUS[5] - fitting) * z / high
    ends = 2 * np.pi * np.trapezoid(profile**2, z)
    whole = ends + np.pi * RADIUS[5] ** 2 * (AT[5] - 2 * high)
    coned = EndCones(0.8, fitting).shape(state)
    agree(coned.volume, whole, 1e-7)
    mean = (2 * np.trapezoid(profile, z) + RADIUS[5] * (AT[5] - 2 * high)) / AT[5]
    agree(coned.diameter, 2 * mean, SOLVED)
    with pytest.raises(AssertionError):
        agree(EndCones(0.8, 0.0121).shape(state).volume, whole, 1e-7)


@pytest.mark.parametrize("fitting", [0.011, RADIUS[0], 0.0135])
def test_cones_of_fixed_height_have_the_closed_form(fitting):
    """The force is P ∂(cone volume)/∂L: a net without share adds nothing."""
    height = 0.02
    force, mean = shown(EndTaper(0.0, fitting, cone_height=height))
    # ΔV = −(2π/3) h (R − Rf)(2R + Rf), ∂R/∂L = −L / (4π²N²R).
    slope = -AT / (4 * np.pi**2 * TURNS**2 * RADIUS)
    loss = PRESSURE * (2 * np.pi / 3) * height * (4 * RADIUS - fitting) * slope
    agree(force, FORCE + loss, SOLVED)
    agree(mean, 2 * RADIUS - 2 * height * (RADIUS - fitting) / AT, ROUNDING)


@pytest.mark.slow
def test_volume_of_cones_of_fixed_height_agrees_with_frusta():
    state, height, fitting = Cylinder()(AT[5], THREAD, TURNS), 0.02, 0.012
    profile = np.linspace(fitting, RADIUS[5], 4001)
    ends = 2 * np.pi * np.trapezoid(profile**2, np.linspace(0, height, profile.size))
    whole = ends + np.pi * RADIUS[5] ** 2 * (AT[5] - 2 * height)
    agree(EndTaper(0.0, fitting, cone_height=height).shape(state).volume, whole, 1e-7)
    with pytest.raises(AssertionError):
        agree(EndTaper(0.0, fitting, cone_height=1.01 * height).shape(state).volume, whole, 1e-7)


def test_tondu_factor_gives_the_force_at_k_times_the_contraction():
    force, wide = shown(ContractionFactor(0.05, LENGTH))
    counted = LENGTH * (1 - 1.05 * CONTRACTION)
    agree(force, np.asarray(braid.gaylord_force(PRESSURE, counted, THREAD, TURNS)), SOLVED, 1e3)
    agree(wide, 2 * RADIUS, ROUNDING)
    # A factor on the force, which is another law, differs.
    with pytest.raises(AssertionError):
        agree(force, FORCE * force[1] / FORCE[1], SOLVED, 1e3)


def best(share, of):
    """Return the rms residual of a force loss after the best fit of a shape, N."""
    return np.sqrt(np.mean((of - share * (share @ of) / (share @ share)) ** 2))


@pytest.mark.slow
def test_net_fits_a_net_of_rings_better_than_the_alternatives():
    """The net: within 7 % of a noise of 5 N, no parameter. The alternatives: with their best parameter."""
    noise, fitting = 5.0, RADIUS[0]
    slope = jax.jit(jax.grad(lambda z: solve_net(z, THREAD, TURNS, fitting).volume))
    at = LENGTH * (1 - np.array([0.02, 0.05, 0.1, 0.15, 0.2, 0.3]))
    # Rings give a length for a force; with the force of the net, the lengths nearly agree with these.
    force = np.array([-PRESSURE * float(slope(z)) for z in at])
    lengths = [[rings(f, fitting, count)[0] for f in force] for count in (100, 200)]
    length = np.array(lengths[1]) + (np.array(lengths[1]) - np.array(lengths[0])) / 3
    by_net = np.array([-PRESSURE * float(slope(z)) for z in length])
    assert np.sqrt(np.mean((by_net - force) ** 2)) < 0.07 * noise

    radius = np.sqrt(THREAD**2 - length**2) / (2 * np.pi * TURNS)
    lost = force - PRESSURE * (3 * length**2 - THREAD**2) / (4 * np.pi * TURNS**2)
    assert best((radius - fitting) * length, lost) > 10 * noise
    assert best(length * (LENGTH - length), lost) > 10 * noise


def test_end_effects_exclude_each_other():
    with pytest.raises(BadInput, match="both describe the same force loss at the ends"):
        check_exclusive_pairs(["end_cones", "end_taper"])
    check_exclusive_pairs(["end_cones", "bladder_elasticity"])
