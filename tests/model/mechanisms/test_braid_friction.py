"""Friction of threads: strength, sliding angle, and the four elements, one parameter at a time."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pamjax.model.mechanisms.braid_friction import BraidFriction
from pamjax.parameter import list_values, replace_values
from tests.agreement import ROUNDING, SOLVED, agree, printed
from tests.model.mechanisms.triangle import THREAD, TURNS, compiled, one_run, past, state

#: Force of a coefficient of one at 0.2 m and 300 kPa, N: (2/3) r P L / N, patches of 0.5 mm.
FULL = 2 / 3 * 0.5e-3 * 300e3 * 0.2 / 1.25


def strength(pressure=300e3, length=0.2, **numbers):
    return BraidFriction(**numbers).strength(jnp.asarray(pressure), state(length))


def test_strength_of_turning_crossings():
    """Section E2: (2/3) μ r P L / N is 10 N at rest for μ = 0.2 on the Kevlar muscle."""
    agree(strength(), FULL, ROUNDING)
    agree(strength(600e3, 0.1), FULL, ROUNDING)
    kevlar = 689.48e3 * 0.235744 / 1.09
    printed(0.2 * FULL / (300e3 * 0.2 / 1.25) * kevlar, "10")


@pytest.mark.parametrize(
    ("numbers", "share"),
    [
        # (sin θ)^(p−1) with sin θ = 0.8, and (cos θ)^k with cos θ = 0.6.
        ({"reach": 0.0}, 1 / 0.8),
        ({"reach": -1.0}, 1 / 0.8**2),
        ({"girth": 2.0}, 0.6**2),
        ({"girth": -1.0}, 1 / 0.6),
        ({"reach": 0.0, "girth": 1.0}, 0.6 / 0.8),
    ],
)
def test_strength_grows_with_powers_of_length_and_radius(numbers, share):
    agree(strength(**numbers), FULL * share, ROUNDING)


def test_strength_grows_with_a_power_of_pressure():
    # P (P/Pr)^(m−1): eightfold pressure gives fourfold strength at m = 2/3, and suction gives none;
    # below 1 kPa it is proportional to pressure, with the factor of the power at 1 kPa.
    agree(strength(2400e3, exponent=2 / 3), 4 * FULL, ROUNDING)
    agree(strength(300e3, exponent=2 / 3), FULL, ROUNDING)
    agree(strength(-1e5), 0.0, ROUNDING, 1.0)
    agree(strength(0.3e3, exponent=0.5), FULL / 1000 * math.sqrt(300), ROUNDING)


def test_strength_of_a_straight_muscle_is_finite():
    # Cosines below a thousandth are clipped.
    agree(strength(length=0.25, girth=-1.0), FULL * 0.25 / 0.2 * 1000, ROUNDING)


# The sliding coordinate.


def rubbing(pressure=0.0, **numbers):
    return BraidFriction(**numbers).strains(state(0.2), pressure)[0]


def test_sliding_coordinate_is_the_sine_or_the_angle_less_the_elastic_part():
    # (1 − h) sin θ + h θ − γ P / B, with θ = arcsin 0.8.
    angle = math.asin(0.8)
    agree(rubbing(), 0.8, ROUNDING)
    agree(rubbing(angle=1.0), angle, ROUNDING)
    agree(rubbing(angle=0.25), 0.75 * 0.8 + 0.25 * angle, ROUNDING)
    agree(rubbing(5e5, give=2e-9), 0.8 - 2e-9 * 5e5 / THREAD, ROUNDING)


def test_stretch_of_the_threads_changes_the_sliding_coordinate():
    """Threads of 0.25 m, stretched to 0.26 m: they turn the crossings in full, by half, or not at all."""
    stretched = state(0.2, 0.26)
    for share, thread in ((1.0, 0.26), (0.5, 0.255), (0.0, 0.25)):
        friction = BraidFriction(stretch=share).prepare(jnp.asarray(0.25), jnp.asarray(TURNS))
        agree(friction.strains(stretched, 0.0)[0], 0.2 / thread, ROUNDING)
    # Alone, a friction knows no unstretched length.
    agree(BraidFriction(stretch=0.5).strains(stretched, 0.0)[0], 0.2 / 0.26, ROUNDING)


# The friction elements. With h = 0, stress / B is a force, and the sliding coordinate is the length.


def force(friction, moves, pressure=300e3):
    """Return the force (N) after successive changes of the length (m) from 0.2 m."""
    length = 0.2 + np.concatenate([[0.0], np.cumsum(moves)])
    went = past(length, pressure)
    strains = friction.strains(went.state, went.pressure).T
    computed = compiled(friction.stresses, one_run(np.arange(length.size)), strains, went)
    return np.asarray(computed)[:, 0] / THREAD


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize(
    ("spread", "mean"),
    [
        # A move of 1.5 mm over distances of 4 mm × [1 − w (3/4, 2/4, 1/4, 0)], each fraction at most one.
        (0.0, 1.5 / 4),
        (0.5, (1.5 / 2.5 + 1.5 / 3.0 + 1.5 / 3.5 + 1.5 / 4.0) / 4),
        (1.0, (1 + 1.5 / 2.0 + 1.5 / 3.0 + 1.5 / 4.0) / 4),
    ],
)
def test_elements_slide_one_after_the_other(spread, mean, way):
    """Section E: lengthening increases the force; 5 N of Coulomb friction."""
    friction = BraidFriction(constant=5.0, presliding=4e-3, spread=spread)
    agree(force(friction, [way * 1.5e-3]), [0.0, way * 5 * mean], SOLVED, 1.0)
    agree(force(friction, [way * 9e-3])[-1], way * 5.0, ROUNDING)


def test_coefficient_gives_its_friction_force():
    # Stiffness at 300 kPa and sin θ = 1: (2/3) r Pr B / N over 4 mm; limit at 600 kPa.
    friction = BraidFriction(0.2, presliding=4e-3, spread=0.0)
    stiff = 0.2 * 2 / 3 * 0.5e-3 * 300e3 * THREAD / TURNS / 4e-3
    agree(force(friction, [1e-3], 600e3)[-1], stiff * 1e-3, SOLVED)
    agree(force(friction, [20e-3], 600e3)[-1], 0.2 * 2 * FULL * 0.22 / 0.2, SOLVED)
    agree(force(friction, [-20e-3], 600e3)[-1], -0.2 * 2 * FULL * 0.18 / 0.2, SOLVED)


def test_frictions_are_additive():
    friction = BraidFriction(0.2, 5.0, presliding=1e-3)
    agree(force(friction, [20e-3])[-1], 5 + 0.2 * FULL * 0.22 / 0.2, SOLVED)


@pytest.mark.parametrize("start", [-0.5, 1.0])
def test_elements_start_in_the_sliding_state(start):
    # s (Fc + μ S) in the first sample; s = 1 is full sliding by lengthening.
    friction = BraidFriction(0.2, 5.0, start=start)
    agree(force(friction, []), [start * (5 + 0.2 * FULL)], ROUNDING)


def test_full_sliding_force_includes_both_frictions():
    friction = BraidFriction(0.2, 5.0)
    agree(friction.full_sliding_stress(past(0.2, 300e3)), [[(5 + 0.2 * FULL) * THREAD]], ROUNDING)


def test_friction_of_rotation_increases_towards_rest():
    # With h = 1 the stress is a moment on θ: F = Fc B ∂θ/∂L = Fc / cos θ; the elements are full here.
    friction = BraidFriction(constant=5.0, presliding=1e-6, angle=1.0)
    agree(force(friction, [1e-3])[-1], 5.0, ROUNDING)
    there = np.array([friction.strains(state(0.2 + z), 0.0)[0] for z in (-1e-6, 1e-6)])
    agree(5 * THREAD * np.diff(there) / 2e-6, [5 / 0.6], 1e-6)


def test_pressure_increase_acts_like_shortening():
    # γ dP = 1e-8 m/Pa × 100 kPa = 1 mm of 4 mm.
    friction = BraidFriction(constant=5.0, presliding=4e-3, spread=0.0, give=1e-8)
    agree(force(friction, [0.0], np.array([3e5, 4e5]))[-1], -5 / 4, SOLVED)


# The direction and the speed.


@pytest.mark.parametrize(("move", "share"), [(20e-3, 1.4), (-20e-3, -0.6)])
def test_asymmetric_friction_is_stronger_in_one_direction(move, share):
    # Limits of (1 + a) and (1 − a) with a = 0.4: 5 N are 7 N after lengthening and 3 N after shortening.
    friction = BraidFriction(0.2, 5.0, presliding=1e-3, asymmetry=0.4)
    agree(force(friction, [move])[-1], share * (5 + 0.2 * FULL * (0.2 + move) / 0.2), SOLVED)
    # The presliding stiffness is the same on both sides: 0.1 mm of 1 mm gives 0.5 N.
    even = BraidFriction(constant=5.0, presliding=1e-3, spread=0.0, asymmetry=0.4)
    agree(force(even, [np.sign(move) * 1e-4])[-1], np.sign(move) * 0.5, SOLVED)


@pytest.mark.parametrize(("start", "share"), [(0.5, 0.5 * 1.4), (-1.0, -0.6)])
def test_start_of_asymmetric_friction_is_a_share_of_its_side(start, share):
    friction = BraidFriction(0.2, 5.0, start=start, asymmetry=0.4)
    agree(force(friction, []), [share * (5 + 0.2 * FULL)], ROUNDING)


@pytest.mark.parametrize("asymmetry", [0.4, -0.4])
def test_largest_sliding_force_is_that_of_the_stronger_side(asymmetry):
    friction = BraidFriction(0.2, 5.0, asymmetry=asymmetry)
    agree(friction.full_sliding_stress(past(0.2, 300e3)), [[1.4 * (5 + 0.2 * FULL) * THREAD]], ROUNDING)


@pytest.mark.parametrize("way", [1, -1])
@pytest.mark.parametrize(
    ("speed", "share"),
    # 1 − c (1 − exp(−(v/vs)²)) with c = 0.6, v = 2 mm/s and vs = v, v / 10 and 100 v.
    [(2e-3, 1 - 0.6 * (1 - math.exp(-1))), (2e-4, 0.4), (0.2, 1 - 0.6e-4)],
)
def test_friction_becomes_weaker_with_speed(speed, share, way):
    friction = BraidFriction(0.2, 5.0, presliding=1e-4, weakening=0.6, weakening_speed=speed)
    slid = force(friction, [way * 2e-3] * 6)
    full = 5 + 0.2 * FULL * (0.2 + way * 2e-3 * np.arange(7)) / 0.2
    agree(slid[3], way * share * full[3], 1e-8)


def test_friction_of_a_hold_has_no_weakening():
    # Slides 2 mm/s, then holds: the elements keep their deflection, which is that of sliding.
    friction = BraidFriction(constant=5.0, presliding=1e-4, weakening=0.6, weakening_speed=2e-4)
    slid = force(friction, [2e-3] * 8 + [0.0] * 8)
    agree(friction.speed_factor(jnp.zeros(())), 1.0, ROUNDING)
    agree(slid[5], 0.4 * 5, SOLVED)
    assert np.all(slid[9:] >= 0.4 * 5 - 1e-9)
    agree(slid[-1], slid[12], SOLVED)


def test_derivatives_are_finite_at_rest_and_at_a_reversal():
    friction = BraidFriction(0.2, 5.0, presliding=1e-3, weakening=0.3, weakening_speed=1e-3, asymmetry=0.2)
    names = list(list_values(friction))
    length = 0.2 + 1e-3 * np.array([0, 0, 0, 1, 2, 3, 2, 1, 0, 0, 0.0])
    went = past(length, 300e3)

    def stress(x):
        moved = replace_values(friction, dict(zip(names, x, strict=True)))
        strains = moved.strains(went.state, went.pressure).T
        return moved.stresses(one_run(np.arange(length.size)), strains, went)[:, 0]

    at = jnp.asarray([float(v) for v in list_values(friction).values()])
    assert np.all(np.isfinite(jax.jit(jax.jacfwd(stress))(at)))
    assert np.all(np.isfinite(jax.jit(jax.jacrev(stress))(at)))
