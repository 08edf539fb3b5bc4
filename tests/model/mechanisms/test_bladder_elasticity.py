"""The elastic wall agrees with a thick tube, and loses contact at low pressure."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from pamjax.model import wall
from pamjax.model.balance import Status
from pamjax.model.mechanisms.bladder_elasticity import BladderElasticity
from pamjax.model.mechanisms.braid_elasticity import BraidElasticity
from pamjax.model.muscle import Muscle, predict
from pamjax.model.thread import LinearThread
from tests.agreement import ROUNDING, SOLVED, agree, difference
from tests.model.mechanisms.rubber import (
    LATEX,
    REST,
    SIZE,
    STIFFNESS,
    THREAD,
    TURNS,
    bench,
    clock,
    cylinder,
    shown,
)
from tests.model.mechanisms.triangle import tube

#: Relative error of a thick wall that is represented by its middle radius.
MIDDLE = 2e-3
#: Small regularisation of a slack muscle without rubber, relative to force and diameter.
HELD = 2e-3


jitted = jax.jit(lambda bench, pressure, length, past: bench(pressure, length, past))


def thick(mooney, radius, length, size=SIZE):
    """Return the energy of a thick tube / modulus, by quadrature through its wall, m³."""
    inner = size["inner_diameter"] / 2
    outer, axial = inner + size["thickness"], length / size["length"]
    bore = radius**2 - (outer**2 - inner**2) / axial

    def density(r):
        hoop = np.sqrt(bore + (r**2 - inner**2) / axial) / r
        radial = 1 / (axial * hoop)
        first = axial**2 + hoop**2 + radial**2 - 3
        second = axial**-2 + hoop**-2 + radial**-2 - 3
        return (first + mooney * (second - first)) * np.pi * r * size["length"]

    return quad(density, inner, outer, epsabs=0, epsrel=1e-11)[0]


def of_middle(mooney, size=SIZE):
    return BladderElasticity(1.0, mooney, **size)


# --- the elastic wall


@pytest.mark.parametrize("mooney", [0.0, 0.4, 1.0])
@pytest.mark.parametrize("contraction", [0.0, 0.05, 0.15, 0.36])
def test_middle_radius_approximates_a_thick_tube(mooney, contraction):
    length = REST * (1 - contraction)
    rubber = of_middle(mooney)

    def exact(length):
        return thick(mooney, float(cylinder(length).radius), length)

    agree(rubber.energy(cylinder(length)), exact(length), MIDDLE)
    force = jax.grad(lambda length: rubber.energy(cylinder(length)))(length)
    agree(force, difference(exact, length, 1e-4), MIDDLE)


def test_outer_radius_does_not_approximate_a_thick_tube():
    rubber, length = of_middle(0.0), 0.9 * REST
    state = cylinder(length)
    outer = state.radius / (SIZE["inner_diameter"] / 2 + SIZE["thickness"])
    axial = length / REST
    wrong = wall.first_invariant(wall.Stretch(jnp.asarray(axial), outer, 1 / (axial * outer)))
    assert 0.5 * wall.rubber_volume(rubber) * wrong < 0.9 * thick(0.0, float(state.radius), length)


@pytest.mark.parametrize("mooney", [0.0, 0.3])
def test_thin_wall_has_the_forces_of_a_membrane(mooney):
    size = {**SIZE, "inner_diameter": 22e-3, "thickness": 1e-5}
    length = 0.85 * REST
    force = jax.grad(lambda length: of_middle(mooney, size).energy(cylinder(length)))(length)
    radius = float(cylinder(length).radius)
    z, c = length / REST, radius / 11e-3
    r, c10, c01 = 1 / (z * c), (1 - mooney) / 2, mooney / 2
    along = 2 * (c10 + c01 * c**2) * (z**2 - r**2)
    around = 2 * (c10 + c01 * z**2) * (c**2 - r**2)
    tangent = length / (2 * np.pi * TURNS * radius)
    volume = np.pi * 1e-5 * 22e-3 * REST
    # The wall is 1/2000 of the radius.
    agree(force, volume / length * (along - around * tangent**2), 2e-3)


@pytest.mark.parametrize(
    ("mooney", "contraction", "says"), [(0.0, 0.1, -346), (0.0, 0.356, -270), (0.4, 0.356, -187)]
)
def test_force_of_a_latex_bladder(mooney, contraction, says):
    rubber = BladderElasticity(LATEX, mooney, **SIZE)
    force = jax.grad(lambda length: rubber.energy(cylinder(length)))(REST * (1 - contraction))
    assert abs(force - says) < 1.0


def test_unstretched_wall_has_neither_energy_nor_force():
    radius = SIZE["inner_diameter"] / 2 + SIZE["thickness"]
    thread = np.hypot(REST, 2 * np.pi * TURNS * radius)
    rubber = BladderElasticity(LATEX, 0.3, **SIZE)
    energy, slopes = jax.value_and_grad(lambda at: rubber.energy(cylinder(*at)))(jnp.array([REST, thread]))
    assert abs(energy) < 1e-12
    agree(slopes, jnp.zeros(2), to=1e-9, scale=1.0)


def test_stresses_are_slopes_of_the_energy():
    def energy(z, c):
        return wall.first_invariant(wall.Stretch(z, c, 1 / (z * c))) / 2

    z, c = jnp.asarray(0.7), jnp.asarray(1.9)
    agree(
        wall.neo_hookean_stresses(wall.Stretch(z, c, 1 / (z * c))), jax.grad(energy, (0, 1))(z, c), ROUNDING
    )


def test_a_braid_too_narrow_for_the_rubber_stays_finite():
    rubber = BladderElasticity(LATEX, 0.3, **SIZE)
    radius = jnp.linspace(0.0, 9e-3, 200)
    thread = jnp.hypot(REST, 2 * jnp.pi * TURNS * radius)
    slope = jax.grad(lambda b: rubber.energy(cylinder(REST, b)))
    slopes, curves = jax.jit(jax.vmap(slope))(thread), jax.jit(jax.vmap(jax.grad(slope)))(thread[1:])
    assert jnp.all(jnp.isfinite(slopes))
    assert jnp.all(jnp.isfinite(curves))


def test_force_of_the_rubber_is_independent_of_pressure():
    length = np.full(4, 0.85 * REST)
    pressure = np.array([1e5, 2e5, 4e5, 6.9e5])
    with_it = shown([BladderElasticity(LATEX, **SIZE)], pressure, length).force
    lost = with_it - shown([], pressure, length).force
    agree(lost, lost[0], SOLVED)
    with_none = shown([BladderElasticity(LATEX, **{**SIZE, "thickness": 1e-9})], pressure, length).force
    agree(with_none - shown([], pressure, length).force, jnp.zeros(4), to=1e-3, scale=1.0)


# --- loss of contact


@jax.jit
def works(rubber, pressure, length, thread):
    """Return the derivatives of the potential without threads, by length and by thread length, N."""

    def potential(at, thread):
        state = cylinder(at, thread)
        return rubber.energy(state) - pressure * state.volume

    return jax.grad(potential, (0, 1))(length, thread)


def stands_off(rubber, pressure, length, compliance):
    """Return force, diameter and load by complementarity: a free tube, or one in contact with threads."""
    thread = THREAD
    if works(rubber, pressure, length, THREAD)[1] <= 0:
        for _ in range(20):
            thread = THREAD * (1 - compliance * float(works(rubber, pressure, length, thread)[1]))
    else:
        narrow = float(np.hypot(length, 2 * np.pi * TURNS * 4e-3))
        thread = brentq(lambda b: float(works(rubber, pressure, length, b)[1]), narrow, THREAD, xtol=1e-15)
    along, around = works(rubber, pressure, length, thread)
    return float(along), 2 * float(cylinder(length, thread).radius), -float(around)


@pytest.mark.parametrize(("modulus", "mooney"), [(LATEX, 0.0), (1.5e6, 0.4), (0.1e6, 0.1)])
def test_contact_is_lost_if_the_rubber_carries_the_pressure(modulus, mooney):
    rubber, random = BladderElasticity(modulus, mooney, **SIZE), np.random.default_rng(3)
    pressure = random.uniform(0, 130e3, 24) * modulus / LATEX
    pressure[0] = 0.0
    length = REST * (1 - random.uniform(0, 0.37, 24))
    seen = shown([BraidElasticity(1 / STIFFNESS), rubber], pressure, length)
    want = np.array([stands_off(rubber, p, x, 1 / STIFFNESS) for p, x in zip(pressure, length, strict=True)])
    slack = np.asarray(seen.states.load) == 0
    assert 4 < slack.sum() < 20
    assert np.all(np.asarray(seen.status) == int(Status.OK))
    agree(seen.states.load[~slack], want[~slack, 2], SOLVED, scale=1.0)
    agree(seen.force, want[:, 0], HELD, scale=100.0)
    agree(seen.diameter, want[:, 1], HELD)


@pytest.mark.parametrize(("contraction", "threshold"), [(0.0, 28.0e3), (0.36, 92.5e3)])
def test_pressure_at_which_contact_is_lost(contraction, threshold):
    rubber, length = BladderElasticity(LATEX, **SIZE), REST * (1 - contraction)
    pressure = threshold + np.array([-300.0, 300.0])
    load = shown([rubber], pressure, [length, length]).states.load
    assert load[0] == 0 < load[1]


def test_equilibrium_is_solved_over_the_range_of_recordings():
    random, n = np.random.default_rng(0), 4000
    # At longer lengths a stiff wall does not fit the braid, and the status reports it.
    pressure, length = random.uniform(-3e3, 7e5, n), REST * (1 - random.uniform(-0.02, 0.45, n))
    pressure[: n // 2] = random.uniform(-3e3, 1.5e5, n // 2)
    for modulus, mooney in ((LATEX, 0.0), (3e6, 1.0), (1e3, 0.5), (0.0, 0.0)):
        rubber = BladderElasticity(modulus, mooney, **SIZE)
        seen = jitted(
            bench(BraidElasticity(1e-6), rubber), jnp.asarray(pressure), jnp.asarray(length), clock(n)
        )
        assert np.all(np.asarray(seen.status) == int(Status.OK))
        assert jnp.all(jnp.isfinite(seen.force) & jnp.isfinite(seen.diameter))


def test_suction_does_not_close_a_braid_without_rubber():
    pressure, length = np.array([-2e3, -1.0, 0.0, 1.0, 2e5]), np.full(5, 0.9 * REST)
    seen = shown([BraidElasticity(1 / STIFFNESS), BladderElasticity()], pressure, length)
    muscle = predict(Muscle(REST, THREAD, TURNS, LinearThread(STIFFNESS)), pressure, length)
    agree(seen.force, muscle.force, SOLVED, scale=1.0)
    agree(seen.diameter, muscle.diameter, SOLVED)


def test_maxwell_relation_holds():
    # Maxwell's relation, without contact (up to the regularisation) and with contact.
    muscle = bench(BraidElasticity(1e-6), BladderElasticity(LATEX, 0.2, **SIZE))

    def both(pressure, length):
        past = muscle(pressure[None], length[None], clock(1)).states
        return past.force[0], past.state.volume[0]

    slopes = jax.jit(jax.jacfwd(both, (0, 1)))
    for pressure, to in ((4e4, 5e-3), (3e5, 1e-9)):
        (by_pressure, _), (_, by_length) = slopes(jnp.asarray(pressure), jnp.asarray(0.8 * REST))
        agree(by_pressure, -by_length, to)


# --- one parameter at a time


@pytest.mark.parametrize("mooney", [0.0, 0.25, 1.0])
def test_energy_of_a_wall_agrees_with_a_hand_calculation(mooney):
    # A tube of 16 mm bore and 2 mm wall at half of 0.2 m, its middle widened by 1.5: (R + Ri) = 27 mm and
    # R² − Ri² = t (d + t) / λz = 72 mm², so R − Ri = 72/27 mm. Stretches 1/2, 3/2 and 4/3:
    # I1 − 3 = 1/4 + 9/4 + 16/9 − 3 = 23/18, I2 − 3 = 4 + 4/9 + 9/16 − 3 = 289/144, V = π t (d + t) l.
    rubber = BladderElasticity(0.4e6, mooney, inner_diameter=16e-3, thickness=2e-3, length=0.2)
    of_first, of_second = (1 - mooney) * 23 / 18, mooney * 289 / 144
    volume = np.pi * 2e-3 * 18e-3 * 0.2
    computed = rubber.energy(tube(0.1, 0.5 * (27 + 72 / 27) * 1e-3))
    agree(computed, 0.5 * 0.4e6 * volume * (of_first + of_second), ROUNDING)


def test_stiffening_adds_the_square_of_the_first_invariant():
    # The same wall: k (I1 − 3)² with I1 − 3 = 23/18 and k = 0.3, neo-Hookean and Mooney-Rivlin.
    volume = np.pi * 2e-3 * 18e-3 * 0.2
    for mooney, linear in ((0.0, 23 / 18), (1.0, 289 / 144)):
        rubber = BladderElasticity(0.4e6, mooney, 16e-3, 2e-3, 0.2, stiffening=0.3)
        computed = rubber.energy(tube(0.1, 0.5 * (27 + 72 / 27) * 1e-3))
        agree(computed, 0.5 * 0.4e6 * volume * (linear + 0.3 * (23 / 18) ** 2), ROUNDING)


def test_stiffening_acts_like_the_limit_of_gent_at_moderate_stretch():
    """−J/2 ln(1 − (I1 − 3)/J) is ½ [(I1 − 3) + (I1 − 3)² / (2 J)] up to the third power of (I1 − 3) / J."""
    limit, length = 60.0, 0.75 * REST
    rubber = BladderElasticity(LATEX, **SIZE, stiffening=1 / (2 * limit))

    def gent(length):
        first = wall.first_invariant(wall.stretch(rubber, cylinder(length)))
        return -0.5 * LATEX * wall.rubber_volume(rubber) * limit * jnp.log1p(-first / limit)

    force, soft = (
        jax.grad(lambda x, r=r: r.energy(cylinder(x)))(length)
        for r in (rubber, BladderElasticity(LATEX, **SIZE))
    )
    agree(force, jax.grad(gent)(length), 5e-3)
    assert difference(gent, length, 1e-4) < 1.02 * soft < 0


def test_derivatives_by_stiffening_are_finite_in_the_unstretched_wall():
    def energy(x):
        return BladderElasticity(LATEX, 0.2, x[1], 2e-3, 0.2, x[0]).energy(tube(0.2, 10e-3))

    at = jnp.array([0.0, 16e-3])
    assert np.all(np.isfinite(jax.hessian(energy)(at)))
    agree(jax.grad(energy)(at)[0], 0.0, ROUNDING, 1.0)
