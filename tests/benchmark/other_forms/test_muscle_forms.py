"""Braid, rubber and rig in other forms have the values and limits that their docstrings state."""

import math

import jax.numpy as jnp
import numpy as np
import pytest

from pamjax.benchmark.other_forms import braid_forms, rig_forms, rubber_forms
from pamjax.benchmark.other_forms.muscle import (
    BenchPlan,
    Effect,
    TrueBraid,
    simulate_effects,
)
from pamjax.benchmark.other_forms.outside import (
    clip_force,
    compute_fold,
    compute_ringing,
    find_reversals,
    press_on_stop,
    repeat_reading,
)
from pamjax.model import braid as package_braid
from pamjax.model.mechanisms.bladder_elasticity import BladderElasticity
from pamjax.model.mechanisms.end_cones import EndCones
from pamjax.model.state import Cylinder
from tests.agreement import BY_DIFFERENCE, ROUNDING, agree

BRAID = TrueBraid(rest_length=0.2, thread=0.214, turns=1.2)
WALL = rubber_forms.RubberWall(BRAID, bore=0.015, thickness=0.0015, length=0.2)
LENGTHS = np.linspace(0.15, 0.2, 21)
THREAD = np.full(21, 0.214)


def build_plan(pressure=3e5, length=LENGTHS):
    n = length.size
    return BenchPlan(np.arange(float(n)), np.arange(n) == 0, np.full(n, pressure), length)


def test_muscle_without_effects_is_the_ideal_braid():
    readings = simulate_effects(BRAID, build_plan(), [])
    agree(readings.force, package_braid.gaylord_force(3e5, LENGTHS, 0.214, 1.2), ROUNDING)
    agree(readings.diameter, package_braid.diameter(LENGTHS, 0.214, 1.2), ROUNDING)


def test_elastic_threads_have_the_closed_form_of_their_length():
    soft = TrueBraid(0.2, 0.214, 1.2, compliance=2e-6)
    thread = 0.214 / (1 - 2e-6 * 3e5 * LENGTHS * 0.214 / (2 * np.pi * 1.2**2))
    readings = simulate_effects(soft, build_plan(), [])
    agree(readings.force, package_braid.gaylord_force(3e5, LENGTHS, thread, 1.2), 1e-10)


def test_neo_hookean_limits_agree_with_the_rubber_of_the_fit():
    """Yeoh without higher terms, Ogden with exponent two and Gent without a limit are one law."""
    rubber = BladderElasticity(
        modulus=jnp.asarray(3e5), mooney=jnp.asarray(0.0), inner_diameter=jnp.asarray(0.015),
        thickness=jnp.asarray(0.0015), length=jnp.asarray(0.2),
    )  # fmt: skip
    want = rubber.energy(Cylinder()(jnp.asarray(LENGTHS), jnp.asarray(THREAD), jnp.asarray(1.2)))
    for build, to in (
        (rubber_forms.build_yeoh(WALL, 3e5, 0.0, 0.0), 1e-9),
        (rubber_forms.build_ogden(WALL, 3e5, 2.0), 1e-9),
        (rubber_forms.build_gent(WALL, 3e5, 1e7), 1e-5),
    ):
        agree(build(LENGTHS, THREAD), want, to)


def test_rubber_stiffens_with_its_higher_terms():
    x = WALL.compute_first_invariant(LENGTHS, THREAD)
    plain = 0.5 * 3e5 * WALL.volume * x
    agree(
        rubber_forms.build_yeoh(WALL, 3e5, 0.1, 0.02)(LENGTHS, THREAD),
        plain * (1 + 0.1 * x + 0.02 * x**2),
        1e-12,
    )
    limit = 2 * x.max()
    agree(rubber_forms.build_gent(WALL, 3e5, limit)(LENGTHS, THREAD)[np.argmax(x)],
          plain.max() * 2 * math.log(2), 1e-12)  # fmt: skip


def test_rubber_adds_the_slope_of_its_energy_to_the_force():
    energy = rubber_forms.build_ogden(WALL, 1e5, 4.0)
    readings = simulate_effects(BRAID, build_plan(), [Effect(energy=energy)])
    slope = (energy(LENGTHS + 1e-6, THREAD) - energy(LENGTHS - 1e-6, THREAD)) / 2e-6
    agree(readings.force, simulate_effects(BRAID, build_plan(), []).force + slope, BY_DIFFERENCE)


def test_muscle_with_stiff_rubber_is_slack_and_never_pushes():
    energy = rubber_forms.build_yeoh(WALL, 2e6, 0.0, 0.0)
    readings = simulate_effects(BRAID, build_plan(2e4), [Effect(energy=energy)])
    free = simulate_effects(BRAID, build_plan(2e4), [])
    assert readings.force.min() == 0.0
    assert np.all(readings.diameter[readings.force == 0] < free.diameter[readings.force == 0])


def test_relaxation_of_a_step_follows_its_kernel():
    time, step = np.linspace(0.0, 10.0, 2001), np.r_[0.0, np.ones(2000)]
    power = rubber_forms.relax_by_power_law(time, step, 0.4)
    agree(power[1000], 5.0**-0.4 / math.gamma(0.6), 2e-3)
    stretched = rubber_forms.relax_by_stretched_exponential(time, step, 2.0, 0.5)
    agree(stretched[1000], math.exp(-math.sqrt(2.5)), 2e-3)
    assert power[0] == stretched[0] == 0.0


def test_power_law_has_the_elastic_and_the_viscous_limit():
    time, ramp = np.linspace(0.0, 10.0, 201), 3 * np.linspace(0.0, 10.0, 201)
    agree(rubber_forms.relax_by_power_law(time, ramp, 1e-9), ramp, 1e-6, scale=1.0)
    agree(rubber_forms.relax_by_power_law(time, ramp, 1 - 1e-9)[1:], 3.0, 1e-6)


def test_single_exponential_agrees_with_the_maxwell_branch():
    time = np.linspace(0.0, 10.0, 401)
    got = rubber_forms.relax_by_stretched_exponential(time, time, 2.0, 1.0)
    agree(got, 2 * -np.expm1(-time / 2), 1e-4, scale=1.0)


def test_softening_is_one_during_a_first_stretch():
    energy = np.array([0.5, 1.0, 0.8, 1.0, 2.0])
    agree(rubber_forms.soften_exponentially(energy, 0.4), [1, 1, math.exp(-0.5), 1, 1], ROUNDING)
    # The travel is 0.5, 0.7, 0.9 and 1.9; a tenth of 1.9 is the scale.
    agree(rubber_forms.soften_by_travel(energy, 0.1)[:2], [1, math.exp(-0.5 / 0.19)], ROUNDING)


@pytest.mark.parametrize("exponent", [1.0, 2.0, 3.0])
def test_locking_has_a_power_of_the_extension_as_force(exponent):
    energy = braid_forms.lock_extension(BRAID, 5e4, 0.1, exponent)
    force = (energy(LENGTHS + 1e-6, THREAD) - energy(LENGTHS - 1e-6, THREAD)) / 2e-6
    past = np.maximum(0.1 - (1 - LENGTHS / 0.2), 0.0)
    agree(force, 5e4 * past**exponent, 1e-4, scale=1e3)
    assert np.all(energy(LENGTHS, THREAD)[past == 0] == 0.0)


def test_locking_in_the_angle_is_zero_below_its_start():
    energy = braid_forms.lock_angle(4.0, 1.0, 1.0)(LENGTHS, THREAD)
    angle = np.arcsin(LENGTHS / 0.214)
    agree(energy, 2 * np.maximum(angle - 1, 0.0) ** 2, ROUNDING)


def test_cones_agree_with_the_cones_of_the_package():
    radius = BRAID.compute_radius(LENGTHS, THREAD)
    state = Cylinder()(jnp.asarray(LENGTHS), jnp.asarray(THREAD), jnp.asarray(1.2))
    cones = EndCones(height=jnp.asarray(1.0), radius=jnp.asarray(8e-3)).shape(state)
    for k in (0, 20):
        # A cone of the package has a height in proportion to the rise of the radius.
        effect = braid_forms.taper_as_cone(radius[k] - 8e-3, 8e-3)
        assert effect.volume is not None
        assert effect.mean_radius is not None
        agree(effect.volume(LENGTHS, radius)[k], (cones.volume - state.volume)[k], 1e-9)
        agree(2 * effect.mean_radius(LENGTHS, radius)[k], (cones.diameter - state.diameter)[k], 1e-9)


@pytest.mark.parametrize(
    ("taper", "profile"),
    [
        (braid_forms.taper_as_clamp, lambda s: 0 * s),
        (braid_forms.taper_as_parabola, lambda s: s * (2 - s)),
        (braid_forms.taper_as_cone, lambda s: s),
    ],
)
def test_ends_have_the_volume_of_their_profile(taper, profile):
    effect, s = taper(0.02, 8e-3), (np.arange(20000) + 0.5) / 20000
    r = 8e-3 + 4e-3 * profile(s)
    at = np.array([0.18]), np.array([12e-3])
    assert effect.volume(*at)[0] == pytest.approx(2 * 0.02 * np.pi * (np.mean(r**2) - 12e-3**2), rel=1e-6)
    assert effect.mean_radius(*at)[0] == pytest.approx(2 * 0.02 / 0.18 * (np.mean(r) - 12e-3), rel=1e-6)


def test_crimp_is_pulled_out_at_its_load():
    load = np.array([0.0, 25.0, 100.0, 300.0])
    agree(braid_forms.uncrimp_with_corner(load, 0.004, 100.0), [0, 0.001, 0.004, 0.004], ROUNDING)
    agree(braid_forms.uncrimp_by_recruitment(load, 0.004, 100.0), [0, 0.003, 0.004, 0.004], ROUNDING)


def test_recruitment_is_the_strain_of_filaments_with_uniform_slack():
    """Slack from 0 to 2c: the load is the mean of E (ε − slack), and the taut thread has T/E."""
    slack, stiffness, c = 2 * 0.004 * (np.arange(20000) + 0.5) / 20000, 1e4, 0.004
    strain = 0.005
    load = stiffness * np.mean(np.maximum(strain - slack, 0.0))
    extra = braid_forms.uncrimp_by_recruitment(np.array(load), c, stiffness * c)
    assert extra == pytest.approx(strain - load / stiffness, rel=1e-3)


def test_power_law_threads_have_their_strain_at_the_reference_load():
    agree(
        braid_forms.stretch_by_power(np.array([0.0, 250.0, 1000.0]), 0.01, 1000.0, 0.5),
        [0, 0.005, 0.01],
        1e-12,
    )


def test_slip_has_two_steps_and_bedding_keeps_the_largest_load():
    time = np.array([0.0, 10.0, 20.0])
    agree(braid_forms.slip_twice(time, 0.01, 0.3, (5.0, 15.0)), [0, 0.003, 0.01], ROUNDING)
    agree(
        braid_forms.bed_in_by_power(np.array([0.0, 5.0, 2.0, 10.0]), 0.01, 2.0),
        [0, 0.0025, 0.0025, 0.01],
        1e-12,
    )


def test_contact_loses_the_pressure_at_first_and_its_threshold_later():
    pressure = np.array([0.0, 1.0, 3e4, 1e9])
    agree(rig_forms.lose_exponentially(pressure, 3e4), [0, 1.0, 3e4 * (1 - math.exp(-1)), 3e4], 1e-4)
    agree(rig_forms.lose_hyperbolically(pressure, 3e4), [0, 1.0, 1.5e4, 3e4], 1e-4)
    agree(rig_forms.lose_exponentially(pressure, 0.0), 0.0, 0)


def test_pressure_drops_have_their_powers():
    flow = np.array([-2.0, 0.0, 1.0])
    agree(rig_forms.drop_by_turbulence(flow, 1.0, 10.0), [-10 * 2**1.75, 0, 10], ROUNDING)
    agree(rig_forms.drop_by_orifice(flow, np.full(3, 101325.0), 1.0, 10.0), [-80, 0, 20], ROUNDING)


def test_rig_deflects_by_its_law():
    force = np.array([-5.0, 0.0, 250.0, 1000.0])
    agree(rig_forms.deflect_by_hertz(force, 1e-3, 1000.0, 0.5), [0, 0, 5e-4, 1e-3], ROUNDING)
    agree(rig_forms.deflect_by_seat(force, 1e-3, 250.0), [0, 0, 5e-4, 8e-4], ROUNDING)


def test_rig_and_muscle_are_in_equilibrium():
    effect = Effect(deflection=lambda force: rig_forms.deflect_by_hertz(force, 1e-3, 500.0, 2 / 3))
    readings = simulate_effects(BRAID, build_plan(), [effect])
    shorter = LENGTHS - rig_forms.deflect_by_hertz(readings.force, 1e-3, 500.0, 2 / 3)
    agree(readings.force, package_braid.gaylord_force(3e5, shorter, 0.214, 1.2), 1e-9)
    agree(readings.length, LENGTHS, 0)


def test_outside_effects_have_their_equations():
    agree(press_on_stop(np.array([0.1, 0.2]), 0.15), [0.0, 0.05], ROUNDING)
    agree(clip_force(np.array([10.0, 90.0]), 50.0), [10.0, 50.0], 0)
    agree(repeat_reading(np.arange(5.0), 1, 2), [0, 1, 1, 1, 4], 0)
    agree(compute_fold(np.array([0.1, 0.12]), 0.1, 0.02), [1.0, np.exp(-0.5)], ROUNDING)


def test_ringing_begins_at_each_reversal():
    time = np.linspace(0.0, 10.0, 1001)
    reversals = find_reversals(time, np.abs(time - 4.0))
    agree(reversals, [4.0], 1e-9)
    course = compute_ringing(time, reversals, 2.0, 3.0)
    assert not course[time < 4.0].any()
    agree(course[time == 4.5], np.exp(-0.5 / 3), 1e-9)
    # A channel at rest between two strokes in one direction does not reverse.
    assert find_reversals(time, np.clip(time, 2, 3) + np.clip(time, 6, 7)).size == 0
