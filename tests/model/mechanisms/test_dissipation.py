"""Friction, damping, slip and a narrow line: closed forms, memory, and dissipation."""

from functools import cache

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pamjax.model.bench import record_bench
from pamjax.model.history import build_time_history
from pamjax.model.mechanisms.braid_elasticity import BraidElasticity
from pamjax.model.mechanisms.braid_friction import PATCH_RADIUS, BraidFriction
from pamjax.model.mechanisms.pressure_drop import PressureDrop
from pamjax.model.mechanisms.rig_compliance import RigCompliance
from pamjax.model.mechanisms.thread_slip import ThreadSlip
from pamjax.model.mechanisms.viscous_damping import ViscousDamping
from tests.agreement import ROUNDING, SOLVED, agree
from tests.model.mechanisms.test_battery import path, work
from tests.model.mechanisms.typical import LENGTH, PRESSURE, THREAD, TURNS, bench

ROWS = 401
TIME = 0.5 * np.arange(ROWS)
ONE_RUN = build_time_history(TIME, np.arange(ROWS) == 0)
LEVEL = np.full(ROWS, PRESSURE)


def stroke(*turns):
    """Return lengths through these multiples of the rest length, in straight lines."""
    return LENGTH * np.interp(np.linspace(0, len(turns) - 1, ROWS), np.arange(len(turns)), turns)


def added(mechanism, pressure, length, past=ONE_RUN):
    """Return the force that a mechanism adds to the bare muscle, N."""
    with_it, without = (
        record_bench(bench(mechanism), pressure, length, past),
        record_bench(bench(), pressure, length, past),
    )
    return np.asarray(with_it.force - without.force)


# Friction: strength.


def test_full_friction_agrees_with_rotating_crossings():
    length = stroke(0.8, 1.0, 0.8)
    force = added(BraidFriction(0.2, presliding=1e-6), LEVEL, length)
    full = 2 / 3 * 0.2 * PATCH_RADIUS * PRESSURE * length / TURNS
    agree(force[1:], (np.sign(np.diff(length)) * full[1:]), SOLVED, 10.0)


def test_work_of_full_friction_agrees_with_the_torques():
    """Σ over n² N / 2 crossings of the torque (2/3) μ r p times the rotation 2θ; the p sum to P π R L."""
    length = LENGTH * np.linspace(0.85, 0.95, ROWS)
    angle, radius = np.arcsin(length / THREAD), np.sqrt(THREAD**2 - length**2) / (2 * np.pi * TURNS)
    torque = 2 / 3 * 0.2 * PATCH_RADIUS * PRESSURE * np.pi * radius * length
    force = added(BraidFriction(0.2, presliding=1e-6), LEVEL, length)
    agree(np.trapezoid(force[1:], length[1:]), np.trapezoid(torque[1:], 2 * angle[1:]), 1e-5)


def test_friction_on_the_lateral_area_is_proportional_to_it():
    length = stroke(0.7, 1.0)
    force = added(BraidFriction(0.2, girth=1.0, presliding=1e-6), LEVEL, length)
    area = length * np.sqrt(THREAD**2 - length**2)
    agree(force[1:] / force[-1], area[1:] / area[-1], SOLVED)
    # Negative control: for rotating crossings it depends on the length only.
    assert np.ptp(length / area) > 0.5 * np.max(length / area)


@pytest.mark.parametrize(("exponent", "ratio"), [(1.0, 8.0), (2 / 3, 4.0)])
def test_strength_grows_with_a_power_of_pressure(exponent, ratio):
    length = stroke(0.9, 1.0)
    friction = BraidFriction(0.2, exponent=exponent, presliding=1e-6)
    low, high, at = (added(friction, np.full(ROWS, p), length)[-1] for p in (1e5, 8e5, 3e5))
    agree(high / low, ratio, SOLVED)
    agree(at, added(BraidFriction(0.2, presliding=1e-6), np.full(ROWS, 3e5), length)[-1], SOLVED)


def test_constant_friction_is_the_same_at_every_pressure():
    for pressure in (0.0, 1e5, 7e5):
        force = added(
            BraidFriction(0.0, 5.0, presliding=1e-6), np.full(ROWS, pressure), stroke(0.9, 1.0, 0.9)
        )
        agree(force[[100, 300]], [5.0, -5.0], SOLVED)


def test_friction_is_independent_of_speed():
    length, slow = stroke(0.9, 1.0, 0.85), build_time_history(37 * TIME, np.arange(ROWS) == 0)
    friction = BraidFriction(0.2, 3.0)
    agree(added(friction, LEVEL, length, slow), added(friction, LEVEL, length), ROUNDING, PRESSURE / 100)


# Friction: memory. Distances refer to threads of constant length, so dL = B d sin θ.


def test_branch_is_twice_the_initial_curve():
    """Masing's rule, at a constant strength."""
    friction, out, back = BraidFriction(0.0, 5.0, presliding=4e-3), 3.1e-3, np.linspace(0, 6.2e-3, ROWS)
    virgin = added(friction, LEVEL, LENGTH * 0.9 + np.linspace(0, out, ROWS))
    halves = np.interp(back / 2, np.linspace(0, out, ROWS), virgin)
    # One row at the turning point, then the return.
    length = np.r_[LENGTH * 0.9, LENGTH * 0.9 + out - back[:-1]]
    branch = added(friction, LEVEL, length)[1:]
    agree(branch, virgin[-1] - 2 * halves[:-1], 1e-3, 5.0)


def test_closed_inner_loop_leaves_no_memory():
    friction, at = BraidFriction(0.1, 4.0, presliding=4e-3), LENGTH * 0.9
    with_loop = at + 1e-3 * np.interp(np.linspace(0, 5, ROWS), range(6), [0, 2, 1.2, 2, 3, 0.5])
    without = at + 1e-3 * np.interp(np.linspace(0, 5, ROWS), [0, 2, 3, 4, 5], [0, 2, 2, 3, 0.5])
    later = slice(int(0.61 * ROWS), None)
    agree(added(friction, LEVEL, with_loop)[later], added(friction, LEVEL, without)[later], SOLVED, 10.0)


def test_friction_is_full_after_the_presliding_distance():
    force = added(BraidFriction(0.0, 5.0, presliding=2e-3), LEVEL, LENGTH * 0.9 + np.linspace(0, 4e-3, ROWS))
    assert force[ROWS // 2 - 2] < 5.0
    agree(force[ROWS // 2 + 1 :], 5.0, SOLVED)


@pytest.mark.parametrize("start", [-1.0, 0.5])
def test_friction_may_start_in_the_sliding_state(start):
    force = added(BraidFriction(0.2, 5.0, start=start), LEVEL, np.full(ROWS, LENGTH))
    agree(force, start * (5.0 + 2 / 3 * 0.2 * PATCH_RADIUS * PRESSURE * LENGTH / TURNS), SOLVED)


def test_memory_continues_across_a_gap_unless_stated():
    starts = np.isin(np.arange(ROWS), [0, ROWS // 2])
    length = stroke(0.9, 1.0, 1.0)
    assert np.all(added(BraidFriction(0.2), LEVEL, length, build_time_history(TIME, starts))[ROWS // 2 :] > 9)
    assert not np.any(
        added(BraidFriction(0.2), LEVEL, length, build_time_history(TIME, starts, restart=True))[ROWS // 2 :]
    )


def test_pressure_moves_elastic_crossings():
    pressure = PRESSURE * np.interp(np.arange(ROWS), [0, 200, 400], [0.2, 1, 0.2])
    still = np.full(ROWS, LENGTH)
    assert not np.any(added(BraidFriction(0.2), pressure, still))
    loop = added(BraidFriction(0.2, presliding=1e-5, give=2e-9), pressure, still)
    full = 2 / 3 * 0.2 * PATCH_RADIUS * pressure * LENGTH / TURNS
    agree(loop[20:200], -full[20:200], SOLVED)
    agree(loop[220:], full[220:], SOLVED)


def test_stretch_of_threads_causes_friction_at_fixed_length():
    pressure = PRESSURE * np.interp(np.arange(ROWS), [0, 200, 400], [0.2, 1, 0.2])
    still, threads = np.full(ROWS, LENGTH), BraidElasticity(1e-6)
    rubbed = record_bench(bench(threads, BraidFriction(0.2, presliding=1e-4)), pressure, still, ONE_RUN)
    loop = np.asarray(rubbed.force - record_bench(bench(threads), pressure, still, ONE_RUN).force)
    assert np.all(loop[20:200] < -1)
    assert np.all(loop[240:] > 1)


@cache
def rubbing(threads):
    def shown(friction, pressure, length):
        past = ONE_RUN
        return record_bench(bench(*threads, friction), pressure, length, past), record_bench(
            bench(*threads), pressure, length, past
        )

    return jax.jit(shown)


@given(
    seed=st.integers(0, 10**6),
    share=st.floats(0.0, 1.0),
    presliding=st.floats(1e-4, 2e-2),
    give=st.floats(0.0, 2e-8),
    exponent=st.floats(0.5, 2.0),
    weakening=st.floats(0.0, 0.9),
    asymmetry=st.floats(-0.8, 0.8),
)
@settings(max_examples=40)
def test_no_path_of_pressure_and_length_gains_work(
    seed, share, presliding, give, exponent, weakening, asymmetry
):
    """∫ q du from a relaxed state, for a varying strength."""
    pressure, length = path(seed, ROWS)
    friction = BraidFriction(
        1.0 - share, 20 * share, exponent, presliding=presliding, give=give, weakening=weakening,
        weakening_speed=5e-4, asymmetry=asymmetry,
    )  # fmt: skip
    rubbed, bare = rubbing(())(friction, pressure, length)
    force = np.asarray(rubbed.force - bare.force)
    # ∮ F dL − V dP, where the stress also changes the volume by force × compliance.
    lost = np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(length - give * pressure))
    assert lost > -1e-4 * np.sum(np.abs(force[1:] * np.diff(length - give * pressure)))
    assert lost > 0


def test_pressure_gains_no_energy_from_a_sliding_element():
    """Slide at low pressure, raise it, return: a stiffness proportional to pressure would gain work."""
    s = np.linspace(0, 4, ROWS)
    length = LENGTH * 0.9 + 4e-4 * np.interp(s, range(5), [0, 1, 1, 0, 0])
    pressure = 1e5 * np.interp(s, range(5), [1, 1, 7, 7, 1])
    rubbed, bare = rubbing(())(BraidFriction(0.3, presliding=1e-3), pressure, length)
    lost = work(rubbed, bare, pressure, length)
    stored = np.max(np.abs(rubbed.force - bare.force)) * 4e-4
    assert lost > -1e-6 * stored


# Damping.


def test_damping_is_proportional_to_speed():
    length = stroke(0.9, 1.0, 0.9)
    speed = 0.1 * LENGTH / (TIME[-1] / 2)
    force = added(ViscousDamping(2e3), LEVEL, length)
    agree(force[[100, 300]], [2e3 * speed, -2e3 * speed], 1e-9)
    faster = added(ViscousDamping(2e3), LEVEL, length, build_time_history(TIME / 3, np.arange(ROWS) == 0))
    agree(faster, 3 * force, 1e-9, 1.0)


def test_damping_is_zero_at_gaps_and_in_static_maps():
    length = np.where(np.arange(ROWS) < 200, 0.9, 1.0) * LENGTH
    past = build_time_history(TIME, np.isin(np.arange(ROWS), [0, 200]))
    agree(added(ViscousDamping(1e5), LEVEL, length, past), 0.0, ROUNDING, PRESSURE)
    static = build_time_history(None, np.arange(ROWS) == 0)
    agree(added(ViscousDamping(1e5), LEVEL, stroke(0.9, 1.0), static), 0.0, ROUNDING, PRESSURE)


# Slip.


def slipped(mechanism, pressure, length, past=ONE_RUN):
    return np.asarray(record_bench(bench(mechanism), pressure, length, past).states.state.thread) / THREAD - 1


def test_bedding_in_depends_on_the_largest_load():
    pressure = PRESSURE * np.interp(np.arange(ROWS), [0, 100, 200, 300, 399], [0.1, 0.6, 0.0, 1.0, 0.0])
    still = np.full(ROWS, LENGTH)
    strain = slipped(ThreadSlip(2e-3, 1500.0), pressure, still)
    largest = np.maximum.accumulate(pressure * LENGTH * THREAD / (2 * np.pi * TURNS**2))
    agree(strain, 2e-3 * (1 - np.exp(-largest / 1500)), SOLVED, 1e-3)
    assert np.all(np.diff(strain) > -1e-15)


def test_slip_occurs_once_and_is_permanent():
    starts = np.isin(np.arange(ROWS), [0, 150, 300])
    strain = slipped(
        ThreadSlip(step=1e-3, when=70.0, during=3.0),
        LEVEL,
        stroke(1, 0.8, 1),
        build_time_history(TIME, starts),
    )
    agree(strain[TIME == 70.0], 0.5e-3, SOLVED)
    agree(strain[[0, -1]], [0, 1e-3], 1e-8, 1e-3)


def test_static_map_has_no_bedding_in():
    past = build_time_history(None, np.arange(ROWS) == 0)
    agree(slipped(ThreadSlip(2e-3, step=1e-3, when=0.0), LEVEL, stroke(1, 0.8), past), 0.0, ROUNDING, 1.0)


@given(seed=st.integers(0, 10**6))
@settings(max_examples=15)
def test_slip_under_load_dissipates_work(seed):
    """∮ F dL + P dV = ∫ T dB over a path that closes in length and pressure, but not in volume."""
    pressure, length = path(seed, ROWS)
    result = losing()(ThreadSlip(2e-3, 1500.0, 1e-3, 40.0, 5.0), pressure, length)
    mean = [
        0.5 * (x[1:] + x[:-1]) for x in map(np.asarray, (result.states.force, pressure, result.states.load))
    ]
    lost = np.sum(mean[0] * np.diff(length) + mean[1] * np.diff(result.states.state.volume))
    assert lost > 0
    agree(lost, np.sum(mean[2] * np.diff(result.states.state.thread)), 2e-2)


@cache
def losing():
    return jax.jit(lambda mechanism, pressure, length: bench(mechanism)(pressure, length, ONE_RUN))


# The line.


def test_pressure_drop_is_quadratic_in_the_volume_slope():
    length = stroke(0.98, 0.94)
    slope = (3 * length**2 - THREAD**2) / (4 * np.pi * TURNS**2)
    speed = np.diff(length)[0] / 0.5
    force = added(PressureDrop(2e8), LEVEL, length)
    agree(force[5:-5], (2e8 * slope**2 * speed)[5:-5], 2e-3)


def test_pressure_drop_vanishes_at_the_largest_volume():
    length = THREAD / np.sqrt(3) * (1 + 1e-4 * np.linspace(-1, 1, ROWS))
    agree(added(PressureDrop(2e8), LEVEL, length), 0.0, 1e-5, 1.0)


@given(seed=st.integers(0, 10**6))
@settings(max_examples=15)
def test_narrow_line_dissipates_work(seed):
    """∮ F dL + P dV with the gauge pressure is the loss of the flow."""
    pressure, length = path(seed, ROWS)
    result = losing()(PressureDrop(2e9), pressure, length)
    force, volume = np.asarray(result.force), np.asarray(result.states.state.volume)
    lost = np.sum(0.5 * (force[1:] + force[:-1]) * np.diff(length))
    lost += np.sum(0.5 * (pressure[1:] + pressure[:-1]) * np.diff(volume))
    agree(lost, np.sum(2e9 * np.diff(volume) ** 2 / 0.5), 2e-2)


# The rig.


def test_rig_compliance_shortens_the_muscle():
    length = stroke(1.0, 0.7)
    reading = record_bench(bench(RigCompliance(2e-7)), LEVEL, length, ONE_RUN)
    agree(reading.states.state.length, length - 2e-7 * reading.force, SOLVED)
    agree(
        reading.force,
        record_bench(bench(), LEVEL, jnp.asarray(length - 2e-7 * reading.force), ONE_RUN).force,
        SOLVED,
    )
