"""Rubber: the elastic wall, contact lost, a dead band, relaxation, softening."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.optimize import brentq

from pamjax.model import wall
from pamjax.model.balance import Status
from pamjax.model.bench import Bench, record
from pamjax.model.history import history
from pamjax.model.mechanism import Past
from pamjax.model.mechanisms.bladder_elasticity import BladderElasticity
from pamjax.model.mechanisms.braid_elasticity import BraidElasticity
from pamjax.model.mechanisms.contact_pressure import ContactPressure
from pamjax.model.mechanisms.mullins_softening import MullinsSoftening
from pamjax.model.mechanisms.viscoelastic_creep import ViscoelasticCreep
from pamjax.model.muscle import Muscle, predict
from pamjax.model.state import Cylinder
from pamjax.model.thread import LinearThread
from pamjax.parameter import field_meanings
from tests.agreement import BY_DIFFERENCE, ROUNDING, SOLVED, agree, difference

# The article's muscle, in a bladder of 22.2 mm and 1/16 inch.
REST, THREAD, TURNS, STIFFNESS = 0.235744, 0.251206, 1.09, 144 * 0.0858e-6 * 80e9
SIZE = {"inner_diameter": 19.025e-3, "thickness": 1.5875e-3, "length": REST}
LATEX = 0.4e6

#: The middle of the wall stands for a thick wall.
MIDDLE = 2e-3
#: Next to nothing: what holds a slack muscle without rubber, relative to force and diameter.
HELD = 2e-3

jitted = jax.jit(lambda bench, pressure, length, past: bench(pressure, length, past))


def bench(*mechanisms):
    return Bench(THREAD, TURNS, mechanisms)


def cylinder(length, thread=THREAD):
    return Cylinder()(length, thread, TURNS)


def clock(n, step=1.0):
    return history(np.arange(n) * step, np.arange(n) == 0)


def shown(mechanisms, pressure, length, past=None):
    length = np.asarray(length, float)
    pressure = np.broadcast_to(np.asarray(pressure, float), length.shape)
    return record(bench(*mechanisms), pressure, length, past or clock(length.size))


def added(mechanism, pressure, length, past=None):
    """Force that a mechanism adds to the bare braid, N."""
    with_it, bare = shown([mechanism], pressure, length, past), shown([], pressure, length)
    return np.asarray(with_it.force - bare.force)


def strokes(contraction, cycles=3, rate=1e-3, step=2.0):
    """Time (s) and length (m) of strokes from rest to a contraction and back."""
    half = REST * contraction / rate
    time = np.arange(0, 2 * half * cycles, step)
    phase = time % (2 * half)
    return time, REST - rate * np.minimum(phase, 2 * half - phase)


def thick(mooney, radius, length, size=SIZE):
    """Energy of a thick tube per modulus, by quadrature through its wall, m³."""
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
def test_middle_of_the_wall_stands_for_a_thick_tube(mooney, contraction):
    length = REST * (1 - contraction)
    rubber = of_middle(mooney)

    def exact(length):
        return thick(mooney, float(cylinder(length).radius), length)

    agree(rubber.energy(cylinder(length)), exact(length), MIDDLE)
    force = jax.grad(lambda length: rubber.energy(cylinder(length)))(length)
    agree(force, difference(exact, length, 1e-4), MIDDLE)


def test_outer_radius_would_not_stand_for_a_thick_tube():
    rubber, length = of_middle(0.0), 0.9 * REST
    state = cylinder(length)
    outer = state.radius / (SIZE["inner_diameter"] / 2 + SIZE["thickness"])
    axial = length / REST
    wrong = wall.first_invariant(wall.Stretch(jnp.asarray(axial), outer, 1 / (axial * outer)))
    assert 0.5 * wall.rubber(rubber) * wrong < 0.9 * thick(0.0, float(state.radius), length)


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
    # A wall of a two-thousandth of the radius.
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
    agree(wall.springs(wall.Stretch(z, c, 1 / (z * c))), jax.grad(energy, (0, 1))(z, c), ROUNDING)


def test_a_braid_too_narrow_for_the_rubber_stays_finite():
    rubber = BladderElasticity(LATEX, 0.3, **SIZE)
    radius = jnp.linspace(0.0, 9e-3, 200)
    thread = jnp.hypot(REST, 2 * jnp.pi * TURNS * radius)
    slope = jax.grad(lambda b: rubber.energy(cylinder(REST, b)))
    slopes, curves = jax.jit(jax.vmap(slope))(thread), jax.jit(jax.vmap(jax.grad(slope)))(thread[1:])
    assert jnp.all(jnp.isfinite(slopes))
    assert jnp.all(jnp.isfinite(curves))


def test_rubber_costs_the_same_force_at_every_pressure():
    length = np.full(4, 0.85 * REST)
    pressure = np.array([1e5, 2e5, 4e5, 6.9e5])
    with_it = shown([BladderElasticity(LATEX, **SIZE)], pressure, length).force
    lost = with_it - shown([], pressure, length).force
    agree(lost, lost[0], SOLVED)
    with_none = shown([BladderElasticity(LATEX, **{**SIZE, "thickness": 1e-9})], pressure, length).force
    agree(with_none - shown([], pressure, length).force, jnp.zeros(4), to=1e-3, scale=1.0)


# --- contact lost


@jax.jit
def works(rubber, pressure, length, thread):
    """Slopes of the potential without threads, by length and by thread, N."""

    def potential(at, thread):
        state = cylinder(at, thread)
        return rubber.energy(state) - pressure * state.volume

    return jax.grad(potential, (0, 1))(length, thread)


def stands_off(rubber, pressure, length, compliance):
    """Force, diameter and load by complementarity: a free tube, or one pressed on threads."""
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
def test_contact_is_lost_where_rubber_takes_all_pressure(modulus, mooney):
    rubber, random = BladderElasticity(modulus, mooney, **SIZE), np.random.default_rng(3)
    pressure = random.uniform(0, 130e3, 24) * modulus / LATEX
    pressure[0] = 0.0
    length = REST * (1 - random.uniform(0, 0.37, 24))
    seen = shown([BraidElasticity(1 / STIFFNESS), rubber], pressure, length)
    want = np.array([stands_off(rubber, p, x, 1 / STIFFNESS) for p, x in zip(pressure, length, strict=True)])
    slack = np.asarray(seen.past.load) == 0
    assert 4 < slack.sum() < 20
    assert np.all(np.asarray(seen.status) == int(Status.OK))
    agree(seen.past.load[~slack], want[~slack, 2], SOLVED, scale=1.0)
    agree(seen.force, want[:, 0], HELD, scale=100.0)
    agree(seen.diameter, want[:, 1], HELD)


@pytest.mark.parametrize(("contraction", "threshold"), [(0.0, 28.0e3), (0.36, 92.5e3)])
def test_pressure_at_which_contact_is_lost(contraction, threshold):
    rubber, length = BladderElasticity(LATEX, **SIZE), REST * (1 - contraction)
    pressure = threshold + np.array([-300.0, 300.0])
    load = shown([rubber], pressure, [length, length]).past.load
    assert load[0] == 0 < load[1]


def test_balance_is_solved_wherever_a_recording_goes():
    random, n = np.random.default_rng(0), 4000
    # Further out a stiff wall no longer fits the braid, and the status says so.
    pressure, length = random.uniform(-3e3, 7e5, n), REST * (1 - random.uniform(-0.02, 0.45, n))
    pressure[: n // 2] = random.uniform(-3e3, 1.5e5, n // 2)
    for modulus, mooney in ((LATEX, 0.0), (3e6, 1.0), (1e3, 0.5), (0.0, 0.0)):
        rubber = BladderElasticity(modulus, mooney, **SIZE)
        seen = jitted(
            bench(BraidElasticity(1e-6), rubber), jnp.asarray(pressure), jnp.asarray(length), clock(n)
        )
        assert np.all(np.asarray(seen.status) == int(Status.OK))
        assert jnp.all(jnp.isfinite(seen.force) & jnp.isfinite(seen.diameter))


def test_suction_closes_no_braid_without_rubber():
    pressure, length = np.array([-2e3, -1.0, 0.0, 1.0, 2e5]), np.full(5, 0.9 * REST)
    seen = shown([BraidElasticity(1 / STIFFNESS), BladderElasticity()], pressure, length)
    muscle = predict(Muscle(REST, THREAD, TURNS, LinearThread(STIFFNESS)), pressure, length)
    agree(seen.force, muscle.force, SOLVED, scale=1.0)
    agree(seen.diameter, muscle.diameter, SOLVED)


def test_memory_pulls_no_bladder_off_a_braid_without_rubber():
    _, length = strokes(0.3, cycles=1)
    seen = shown([ViscoelasticCreep(0.1e6, **SIZE)], 0.0, length)
    agree(seen.diameter, jax.vmap(cylinder)(jnp.asarray(length)).diameter, SOLVED)
    assert np.all(np.asarray(seen.status) == int(Status.OK))


def test_what_pressure_does_to_force_length_does_to_volume():
    # Maxwell's identity, with the bladder standing off (but for what holds it there), and pressing.
    muscle = bench(BraidElasticity(1e-6), BladderElasticity(LATEX, 0.2, **SIZE))

    def both(pressure, length):
        past = muscle(pressure[None], length[None], clock(1)).past
        return past.force[0], past.state.volume[0]

    slopes = jax.jit(jax.jacfwd(both, (0, 1)))
    for pressure, to in ((4e4, 5e-3), (3e5, 1e-9)):
        (by_pressure, _), (_, by_length) = slopes(jnp.asarray(pressure), jnp.asarray(0.8 * REST))
        agree(by_pressure, -by_length, to)


# --- a dead band


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


# --- relaxation


def test_fast_relaxation_leaves_nothing_and_slow_one_a_spring():
    _, length = strokes(0.3, cycles=1)
    still = shown([], 4e5, length).force
    fast = ViscoelasticCreep(LATEX, 0.5, 1e-5, 1e-5, **SIZE)
    agree(shown([fast], 4e5, length).force, still, to=1e-3, scale=1.0)

    # One more wall, less the stress with which it began.
    slow = ViscoelasticCreep(LATEX, 0.5, 1e12, 1e12, **SIZE)
    of_wall = jax.grad(lambda x: BladderElasticity(LATEX, **SIZE).energy(cylinder(x)))
    axial, hoop, radial = wall.stretch(slow, cylinder(length[0]))
    begun = [LATEX * wall.rubber(slow) * s for s in wall.springs(wall.Stretch(axial, hoop, radial))]

    def of_stretch(x):
        axial, hoop, _ = wall.stretch(slow, cylinder(x))
        return begun[0] * axial + begun[1] * hoop

    want = jax.vmap(lambda x: of_wall(x) - jax.grad(of_stretch)(x))(jnp.asarray(length))
    agree(shown([slow], 4e5, length).force - still, want, to=1e-9, scale=1000.0)


def test_holds_end_on_the_resting_curve_from_both_sides():
    rubber = ViscoelasticCreep(0.08e6, 0.5, 5.0, 40.0, **SIZE)
    time = np.concatenate([np.arange(0, 400, 4.0), np.arange(400, 4000, 40.0)])
    shortened = np.interp(time, [0, 50, 4000], [REST, 0.85 * REST, 0.85 * REST])
    lengthened = np.interp(time, [0, 50, 2000, 2050, 4000], np.array([1, 0.7, 0.7, 0.85, 0.85]) * REST)
    past = history(time, time == 0)
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


def test_uneven_steps_tell_the_same_of_a_straight_stretch():
    rubber = ViscoelasticCreep(1.0, 0.3, 4.0, 90.0, **SIZE)
    fine = np.linspace(0, 100, 2001)
    stretches = np.stack([1 - 0.3 * fine / 100, 1.2 + 0.6 * fine / 100], axis=1)
    coarse = np.sort(np.random.default_rng(1).choice(np.arange(1, 2000), 400, replace=False))
    coarse = np.concatenate([[0], coarse, [2000]])

    def stress(rows):
        past = history(fine[rows], fine[rows] == 0)
        return relaxing(rubber, jnp.asarray(stretches[rows]), past)

    # Stress is straight in time, not stretch: the steps matter by their curvature only.
    agree(stress(coarse)[-1], stress(np.arange(2001))[-1], 1e-5)


@pytest.mark.parametrize(("pressure", "contraction", "loop"), [(138e3, 0.23, 10), (689e3, 0.356, 13)])
def test_loop_of_a_relaxing_bladder(pressure, contraction, loop):
    time, length = strokes(contraction)
    rubber = ViscoelasticCreep(0.08e6, 0.5, 10.0, 200.0, **SIZE)
    force = added(rubber, pressure, length, history(time, time == 0))
    half = REST * contraction / 1e-3
    middle = 0.15 * REST / 1e-3
    down, up = np.interp([4 * half + middle, 6 * half - middle], time, force)
    assert abs((up - down) - loop) < 0.5


WALKS = st.lists(
    st.tuples(st.floats(0.6, 1.1), st.floats(0.8, 2.4), st.floats(0.1, 300)), min_size=2, max_size=8
)


def returning(walk, fine=400):
    """Time (s) and stretches along a walk that returns to where it began."""
    corners = np.array([(1.0, 1.15), *((z, c) for z, c, _ in walk), (1.0, 1.15)])
    times = np.cumsum([0.0, *(t for *_, t in walk), 1.0])
    time = np.linspace(0, times[-1], fine)
    path = np.stack([np.interp(time, times, corners[:, k]) for k in (0, 1)], axis=1)
    return time, path


@settings(max_examples=30)
@given(WALKS)
def test_relaxation_only_loses_energy(walk):
    time, path = returning(walk)
    rubber = ViscoelasticCreep(1e6, 0.4, 8.0, 60.0, **SIZE)
    stress = np.asarray(relaxing(rubber, jnp.asarray(path), history(time, time == 0)))
    done = 0.5 * (stress[1:] + stress[:-1]) * np.diff(path, axis=0)
    # The rule of trapezoids is off by the square of a step.
    assert done.sum() > -1e-3 * np.abs(done).sum()


@settings(max_examples=30)
@given(WALKS, st.floats(0.1, 1.0))
def test_softening_only_loses_energy(walk, width):
    time, path = returning(walk)
    energy = path[:, :1] ** 2 + path[:, 1:] ** 2 + (path[:, :1] * path[:, 1:]) ** -2 - 3
    energy[-1] = energy[0]
    rubber = MullinsSoftening(1e6, width, **SIZE)
    energy = np.asarray(0.5 * wall.rubber(rubber) * energy)
    stress = np.asarray(SOFTENING(rubber, jnp.asarray(energy), history(time, time == 0)))
    done = 0.5 * (stress[1:] + stress[:-1]) * np.diff(energy, axis=0)
    assert done.sum() > -1e-2 * np.abs(done).sum()


@jax.jit
def relaxing(rubber, stretches, past):
    """Stress on the stretches of the wall, of a muscle without a force."""
    nothing = jnp.zeros(stretches.shape[0])
    bare = Past(None, nothing, nothing, nothing)
    return rubber.stresses(past, jnp.column_stack([stretches, nothing]), bare)[:, :2]


SOFTENING = jax.jit(lambda m, strains, past: m.stresses(past, strains, None))


# --- softening


def test_only_virgin_stretch_meets_the_extra_stiffness():
    half = np.linspace(0, 1, 60)
    length = REST * (1 - np.concatenate([0.2 * half, 0.2 * half[::-1], 0.3 * half, 0.3 * half[::-1]]))
    lost = np.asarray(
        shown([MullinsSoftening(0.1e6, 0.02, **SIZE)], 4e5, length).force - shown([], 4e5, length).force
    )
    elastic = np.asarray(
        shown([BladderElasticity(0.1e6, **SIZE)], 4e5, length).force - shown([], 4e5, length).force
    )
    agree(lost[:60], elastic[:60], SOLVED, scale=1.0)
    second, beyond = length[120:180] > 0.82 * REST, length[120:180] < 0.799 * REST
    assert np.all(np.abs(lost[120:180][second]) < 1e-3)
    agree(lost[120:180][beyond], elastic[120:180][beyond], SOLVED, scale=1.0)
    assert np.all(np.abs(lost[180:][length[180:] > 0.75 * REST]) < 1e-3)


def test_softening_outlasts_a_gap_and_has_no_place_in_a_static_map():
    length = REST * np.array([1.0, 0.8, 1.0, 0.9, 0.8])
    soft, starts = [MullinsSoftening(0.1e6, 0.05, **SIZE)], np.array([1, 0, 0, 1, 0], bool)
    still = shown([], 4e5, length).force
    gap = history(np.array([0, 10.0, 20, 5000, 5010]), starts)
    lost = shown(soft, 4e5, length, gap).force - still
    assert abs(lost[3]) < 1e-3
    assert lost[4] < -10.0
    agree(shown(soft, 4e5, length, history(None, starts)).force, still, ROUNDING)
    anew = history(np.array([0, 10.0, 20, 5000, 5010]), starts, restart=True)
    assert (shown(soft, 4e5, length, anew).force - still)[3] < -10.0


# --- all of them

ALL = (BladderElasticity, ContactPressure, ViscoelasticCreep, MullinsSoftening)


@pytest.mark.parametrize("kind", ALL)
def test_neutral_changes_nothing_and_its_slope_is_a_signature(kind):
    time, length = strokes(0.25, cycles=1, step=20.0)
    past, pressure = history(time, time == 0), jnp.full(length.size, 3e5)
    numbers = {name: getattr(kind(), name) for name in field_meanings(kind)}
    amplitude, meaning = next((n, m) for n, m in field_meanings(kind).items() if m.neutral is not None)

    @jax.jit
    def force(numbers):
        made = dataclasses.replace(kind(), **numbers)
        return bench(BraidElasticity(1e-6), made)(pressure, jnp.asarray(length), past).force

    agree(force(numbers), shown([BraidElasticity(1e-6)], pressure, length).force, ROUNDING)
    slopes_at = jax.jit(jax.jacfwd(force))
    slopes = slopes_at(numbers)
    assert all(bool(jnp.all(jnp.isfinite(s))) for s in slopes.values())
    assert jnp.max(jnp.abs(slopes[amplitude])) > 0
    at = meaning.high / 20
    forward = slopes_at(numbers | {amplitude: jnp.asarray(at)})
    by_step = difference(lambda a: force(numbers | {amplitude: jnp.asarray(a)}), at, 1e-3 * at)
    agree(forward[amplitude], by_step, BY_DIFFERENCE, scale=float(jnp.max(jnp.abs(by_step))))


def test_forward_and_reverse_mode_agree():
    time, length = strokes(0.25, cycles=1, step=20.0)
    past, pressure = history(time, time == 0), jnp.full(length.size, 3e5)

    def force(amplitudes):
        made = [kind(a) for kind, a in zip(ALL, amplitudes, strict=True)]
        return jnp.sum(bench(BraidElasticity(1e-6), *made)(pressure, jnp.asarray(length), past).force)

    at = jnp.array([LATEX, 5e3, 5e4, 5e4])
    agree(jax.jit(jax.grad(force))(at), jax.jit(jax.jacfwd(force))(at), 1e-8)
