"""Relaxation: its limits (no stress, a spring), holds from both directions, and dissipation."""

import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings

from pamjax.model import wall
from pamjax.model.balance import Status
from pamjax.model.history import build_time_history
from pamjax.model.mechanism import Past
from pamjax.model.mechanisms.bladder_elasticity import BladderElasticity
from pamjax.model.mechanisms.viscoelastic_creep import ViscoelasticCreep
from tests.agreement import ROUNDING, SOLVED, agree
from tests.model.mechanisms.rubber import (
    LATEX,
    REST,
    SIZE,
    WALKS,
    added,
    cylinder,
    returning,
    shown,
    strokes,
)
from tests.model.mechanisms.triangle import compiled, one_run, tube


@jax.jit
def relaxing(rubber, stretches, past):
    """Return the stress on the wall of a muscle without force."""
    nothing = jnp.zeros(stretches.shape[0])
    bare = Past(None, nothing, nothing, nothing)
    return rubber.stresses(past, jnp.column_stack([stretches, nothing]), bare)[:, :2]


def test_fast_relaxation_gives_no_stress_and_slow_relaxation_a_spring():
    _, length = strokes(0.3, cycles=1)
    still = shown([], 4e5, length).force
    fast = ViscoelasticCreep(LATEX, 0.5, 1e-5, 1e-5, **SIZE)
    agree(shown([fast], 4e5, length).force, still, to=1e-3, scale=1.0)

    # The stress of a second wall, less its initial stress.
    slow = ViscoelasticCreep(LATEX, 0.5, 1e12, 1e12, **SIZE)
    of_wall = jax.grad(lambda x: BladderElasticity(LATEX, **SIZE).energy(cylinder(x)))
    axial, hoop, radial = wall.stretch(slow, cylinder(length[0]))
    begun = [
        LATEX * wall.rubber_volume(slow) * s
        for s in wall.neo_hookean_stresses(wall.Stretch(axial, hoop, radial))
    ]

    def of_stretch(x):
        axial, hoop, _ = wall.stretch(slow, cylinder(x))
        return begun[0] * axial + begun[1] * hoop

    want = jax.vmap(lambda x: of_wall(x) - jax.grad(of_stretch)(x))(jnp.asarray(length))
    agree(shown([slow], 4e5, length).force - still, want, to=1e-9, scale=1000.0)


def test_holds_approach_the_equilibrium_curve_from_both_sides():
    rubber = ViscoelasticCreep(0.08e6, 0.5, 5.0, 40.0, **SIZE)
    time = np.concatenate([np.arange(0, 400, 4.0), np.arange(400, 4000, 40.0)])
    shortened = np.interp(time, [0, 50, 4000], [REST, 0.85 * REST, 0.85 * REST])
    lengthened = np.interp(time, [0, 50, 2000, 2050, 4000], np.array([1, 0.7, 0.7, 0.85, 0.85]) * REST)
    past = build_time_history(time, time == 0)
    drift = {}
    for name, length in (("after shortening", shortened), ("after lengthening", lengthened)):
        drift[name] = np.asarray(
            shown([rubber], 4e5, length, past).force - shown([], 4e5, length, past).force
        )
    up, down = drift["after shortening"][time >= 50], drift["after lengthening"][time >= 2080]
    assert np.all(np.diff(up) >= -1e-9)
    assert np.all(np.diff(down) <= 1e-9)
    assert up[0] < -5.0
    assert down[0] > 2.0
    assert abs(up[-1]) + abs(down[-1]) < 1e-6


def test_uneven_time_steps_agree_for_linear_stretch():
    rubber = ViscoelasticCreep(1.0, 0.3, 4.0, 90.0, **SIZE)
    fine = np.linspace(0, 100, 2001)
    stretches = np.stack([1 - 0.3 * fine / 100, 1.2 + 0.6 * fine / 100], axis=1)
    coarse = np.sort(np.random.default_rng(1).choice(np.arange(1, 2000), 400, replace=False))
    coarse = np.concatenate([[0], coarse, [2000]])

    def stress(rows):
        past = build_time_history(fine[rows], fine[rows] == 0)
        return relaxing(rubber, jnp.asarray(stretches[rows]), past)

    # Stress is linear in time, not stretch: the step size matters only through the curvature.
    agree(stress(coarse)[-1], stress(np.arange(2001))[-1], 1e-5)


@pytest.mark.parametrize(("pressure", "contraction", "loop"), [(138e3, 0.23, 10), (689e3, 0.356, 13)])
def test_loop_of_a_relaxing_bladder(pressure, contraction, loop):
    time, length = strokes(contraction)
    rubber = ViscoelasticCreep(0.08e6, 0.5, 10.0, 200.0, **SIZE)
    force = added(rubber, pressure, length, build_time_history(time, time == 0))
    half = REST * contraction / 1e-3
    middle = 0.15 * REST / 1e-3
    down, up = np.interp([4 * half + middle, 6 * half - middle], time, force)
    assert abs((up - down) - loop) < 0.5


def test_relaxation_has_no_effect_without_rubber():
    _, length = strokes(0.3, cycles=1)
    seen = shown([ViscoelasticCreep(0.1e6, **SIZE)], 0.0, length)
    agree(seen.diameter, jax.vmap(cylinder)(jnp.asarray(length)).diameter, SOLVED)
    assert np.all(np.asarray(seen.status) == int(Status.OK))


@settings(max_examples=30)
@given(WALKS)
def test_relaxation_dissipates_energy(walk):
    time, path = returning(walk)
    rubber = ViscoelasticCreep(1e6, 0.4, 8.0, 60.0, **SIZE)
    stress = np.asarray(relaxing(rubber, jnp.asarray(path), build_time_history(time, time == 0)))
    done = 0.5 * (stress[1:] + stress[:-1]) * np.diff(path, axis=0)
    # The error of the trapezoidal rule is quadratic in the step.
    assert done.sum() > -1e-3 * np.abs(done).sum()


#: Shares 1/4 and 3/4 with times of 10 and 20 s; a linear change over 10 s, then a hold of 10 s:
#: g (1 − e^(−x)) / x with x = 10/10 and 10/20, and each times e^(−x) after the hold.
RAMPED = 0.25 * (1 - math.exp(-1)) + 0.75 * (1 - math.exp(-0.5)) / 0.5
HELD = 0.25 * (1 - math.exp(-1)) * math.exp(-1) + 0.75 * (1 - math.exp(-0.5)) / 0.5 * math.exp(-0.5)


def after(rubber, strains, force):
    """Return the stresses at 0, 10 and 20 s."""
    nothing = jnp.zeros(3)
    bare = Past(None, nothing, nothing, jnp.asarray(force))
    return np.asarray(compiled(rubber.stresses, one_run([0.0, 10.0, 20.0]), jnp.asarray(strains), bare))


@pytest.mark.parametrize("step", [100.0, -100.0])
def test_a_share_of_the_force_relaxes(step):
    # The stress along the length is a force in the direction of the change: f × ΔF × the above.
    rubber = ViscoelasticCreep(0.0, 0.25, 10.0, 20.0, 0.1, **SIZE)
    computed = after(rubber, [[1.0, 1.0, 0.2]] * 3, [500.0, 500.0 + step, 500.0 + step])
    agree(computed[:, 2], 0.1 * step * np.array([0.0, RAMPED, HELD]), ROUNDING, 1.0)
    agree(computed[:, :2], 0.0, ROUNDING, 1.0)


def test_stresses_of_the_wall_relax():
    # From the unstretched wall to stretches 1/2, 3/2, 4/3: S = λ − λr² / λ = 1/2 − 32/9 along and 3/2 − 32/27
    # around, times μ V.
    rubber = ViscoelasticCreep(0.4e6, 0.25, 10.0, 20.0, 0.0, **SIZE)
    computed = after(rubber, [[1.0, 1.0, 0.2], [0.5, 1.5, 0.1], [0.5, 1.5, 0.1]], [0.0, 700.0, 700.0])
    stiff = 0.4e6 * math.pi * 1.5875e-3 * 20.6125e-3 * REST
    grown = np.array([0.0, RAMPED, HELD])
    agree(computed[:, 0], stiff * (1 / 2 - 32 / 9) * grown, ROUNDING, stiff)
    agree(computed[:, 1], stiff * (3 / 2 - 32 / 27) * grown, ROUNDING, stiff)
    agree(computed[:, 2], 0.0, ROUNDING, 1.0)


def test_strains_are_the_stretches_of_the_wall_and_the_length():
    # The wall of the tests of the elastic bladder: stretches 1/2 and 3/2.
    rubber = ViscoelasticCreep(1.0, inner_diameter=16e-3, thickness=2e-3, length=0.2)
    computed = rubber.strains(tube(0.1, 0.5 * (27 + 72 / 27) * 1e-3), 0.0)
    agree(computed, [0.5, 1.5, 0.1], ROUNDING)


# The spectrum between the two times.


def test_default_spectrum_has_two_branches():
    times, shares = ViscoelasticCreep(1.0, 0.25, 2.0, 54.0).list_branches()
    agree(times, [2.0, 6.0, 18.0, 54.0], ROUNDING)
    assert shares.tolist() == [0.25, 0.0, 0.0, 0.75]


def test_weights_of_a_power_law_have_a_constant_ratio():
    # g : 1 − g = 8 : 1, so that successive weights differ by a factor of two: 8, 4, 2, 1 of 15.
    spectrum = ViscoelasticCreep(1.0, 8 / 9, 1.0, 1000.0, spectrum=1.0)
    agree(spectrum.list_branches()[1], np.array([8, 4, 2, 1]) / 15, ROUNDING)
    half = ViscoelasticCreep(1.0, 8 / 9, 1.0, 1000.0, spectrum=0.5)
    agree(half.list_branches()[1], [0.5 * (8 / 9 + 8 / 15), 2 / 15, 1 / 15, 0.5 * (1 / 9 + 1 / 15)], ROUNDING)


def test_power_law_relaxes_the_force():
    # Equal weights of a quarter with times of 1, 10, 100 and 1000 s: after a step during 10 s, and a hold.
    rubber = ViscoelasticCreep(0.0, 0.5, 1.0, 1000.0, 0.1, **SIZE, spectrum=1.0)
    computed = after(rubber, [[1.0, 1.0, 0.2]] * 3, [500.0, 600.0, 600.0])
    ratio = 10.0 / np.array([1.0, 10.0, 100.0, 1000.0])
    ramped = (1 - np.exp(-ratio)) / ratio / 4
    agree(computed[1:, 2], [10 * ramped.sum(), 10 * ramped @ np.exp(-ratio)], ROUNDING)


@pytest.mark.parametrize("order", [0.0, 0.15, 0.3])
def test_four_branches_approximate_a_fractional_element(order):
    """A continuous spectrum τ^(−α) between the outer half-steps gives t^(−α) between them."""
    g = 1 / (1 + 1000.0**-order)
    times, shares = (
        np.asarray(x) for x in ViscoelasticCreep(1.0, g, 1.0, 1000.0, spectrum=1.0).list_branches()
    )
    fine = np.geomspace(10**-0.5, 10**3.5, 4001)
    weights = fine**-order
    t = np.geomspace(1.0, 1000.0, 60)
    computed = np.exp(-t[:, None] / times) @ shares
    agree(computed, np.exp(-t[:, None] / fine) @ (weights / weights.sum()), 0.04, 1.0)
    if order:
        # Gamma function: the integral of τ^(−α−1) e^(−t/τ) dτ from 0 to infinity is Γ(α) t^(−α).
        wide = np.geomspace(1e-9, 1e60, 40001)
        decay = np.exp(-np.array([1.0, 100.0])[:, None] / wide) @ wide**-order
        agree(decay[1] / decay[0], 100.0**-order, 1e-6)


def test_derivatives_by_the_spectrum_are_finite_at_its_limits():
    for share in (0.0, 0.5, 1.0):
        for spectrum in (0.0, 1.0):

            def branches(x):
                times, shares = ViscoelasticCreep(1.0, *x[:3], spectrum=x[3]).list_branches()
                return jnp.concatenate([times, shares])

            slopes = jax.jacfwd(branches)(jnp.array([share, 10.0, 200.0, spectrum]))
            assert np.all(np.isfinite(slopes))


@settings(max_examples=15)
@given(WALKS)
def test_power_law_dissipates_energy(walk):
    time, path = returning(walk)
    rubber = ViscoelasticCreep(1e6, 0.7, 2.0, 300.0, **SIZE, spectrum=1.0)
    stress = np.asarray(relaxing(rubber, jnp.asarray(path), build_time_history(time, time == 0)))
    done = 0.5 * (stress[1:] + stress[:-1]) * np.diff(path, axis=0)
    assert done.sum() > -2e-3 * np.abs(done).sum()
