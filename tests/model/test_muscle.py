"""The muscle: one potential gives force, stretch and diameter in every state."""

import dataclasses
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jaxtyping import Array

from pamjax.errors import BadInput
from pamjax.model import braid
from pamjax.model.balance import BURST_LOAD_SHARE, Status
from pamjax.model.muscle import CACHE_BLOCK_STATES, Muscle, contraction, predict
from pamjax.model.state import AbstractTerm, State
from pamjax.model.thread import ExponentialToe, Inextensible, LinearThread, RecruitmentToe, SmoothToe
from pamjax.parameter import Scalar, list_meanings, list_values, parameter, replace_values
from tests.agreement import BY_DIFFERENCE, ROUNDING, SOLVED, agree, difference

L0, B0, N = 0.235744, 0.251206, 1.09
S = 144 * 0.0858e-6 * 80e9
LAWS = {
    "inelastic": Inextensible(),
    "elastic": LinearThread(S),
    "toe": SmoothToe(S, toe_ratio=0.3, crimp=0.003, width=1e-3),
    "exponential-toe": ExponentialToe(S, crimp=0.004, curvature=400.0),
    "recruitment-toe": RecruitmentToe(S, crimp=0.003, spread=1.5e-3),
}
MUSCLES = {name: Muscle(L0, B0, N, law) for name, law in LAWS.items()}
ELASTIC = [m for name, m in MUSCLES.items() if name != "inelastic"]


class Spring(AbstractTerm):
    """A substitute for rubber: springs in volume and length."""

    bulk: Scalar = parameter("Pa/m^3", low=1e8, high=1e10, about="of the volume", source="a test")

    def energy(self, state: State) -> Array:
        return 0.5 * self.bulk * state.volume**2 + 5e3 * (state.length - 0.2) ** 2


every = pytest.mark.parametrize("muscle", MUSCLES.values(), ids=MUSCLES)
elastic = pytest.mark.parametrize("muscle", ELASTIC, ids=list(MUSCLES)[1:])

with_and_without_terms = pytest.mark.parametrize(
    "muscle",
    [*ELASTIC, *(dataclasses.replace(MUSCLES[name], terms=(Spring(1e9),)) for name in ("elastic", "toe"))],
    ids=[*list(MUSCLES)[1:], "elastic-held", "toe-held"],
)

P, L = (a.ravel() for a in np.meshgrid([2e4, 1.5e5, 6.9e5, 2e6], [0.15, 0.19, 0.2357]))


@eqx.filter_jit
def readings(muscle, pressure, length):
    return jax.vmap(muscle)(pressure, length)


def shows(of):
    muscle, pressure, length = of
    reading = muscle(pressure, length)
    return jnp.stack([reading.force, reading.diameter])


def all_slopes(way, muscle, pressure, length):
    """Return derivatives of force and diameter in both inputs and all parameters, at each instant."""
    numbers, rest = eqx.partition(muscle, eqx.is_array)

    def solve_point(p, l):
        m, by_pressure, by_length = way(lambda of: shows((eqx.combine(of[0], rest), *of[1:])))(
            (numbers, p, l)
        )
        return by_pressure, by_length, *jax.tree.leaves(m)

    return jax.vmap(solve_point)(pressure, length)


slopes = eqx.filter_jit(partial(all_slopes, jax.jacfwd))
reverse_slopes = eqx.filter_jit(partial(all_slopes, jax.jacrev))


# --- outputs agree with the braid of stretched threads


@every
def test_force_is_gaylords_with_the_stretched_thread(muscle):
    r = readings(muscle, P, L)
    assert np.all(r.status == Status.OK)
    agree(r.thread, B0 * (1 + r.strain), ROUNDING)
    agree(r.force, braid.gaylord_force(P, L, r.thread, N), ROUNDING, scale=P * B0**2)
    agree(r.diameter, braid.diameter(L, r.thread, N), ROUNDING)
    agree(r.load, braid.hoop_pull(P, L, r.thread, N), ROUNDING)


@elastic
def test_threads_carry_the_hoop_pull(muscle):
    r = readings(muscle, P, L)
    agree(jax.vmap(muscle.thread.load)(r.strain), r.load, SOLVED)


@elastic
def test_force_loss_is_pressure_times_the_added_area(muscle):
    bare, r = readings(MUSCLES["inelastic"], P, L), readings(muscle, P, L)
    added = 0.25 * np.pi * (np.asarray(r.diameter) ** 2 - np.asarray(bare.diameter) ** 2)
    agree(r.force - bare.force, -P * added, ROUNDING, scale=P * B0**2)
    assert np.all(r.force < bare.force)


def test_neutral_toe_agrees_with_the_closed_form():
    toe = dataclasses.replace(MUSCLES["elastic"], thread=SmoothToe(S, 1.0, 0.003, 1e-3))
    both = readings(toe, P, L), readings(MUSCLES["elastic"], P, L)
    for got, expected in zip(*map(jax.tree.leaves, both), strict=True):
        agree(got, expected, SOLVED)


def test_stiff_threads_agree_with_the_inelastic_braid():
    stiff = readings(Muscle(L0, B0, N, LinearThread(1e9)), P, L)
    agree(stiff.force, readings(MUSCLES["inelastic"], P, L).force, 1e-3, scale=P * B0**2 / (4 * np.pi * N**2))


def test_contraction_refers_to_the_rest_length():
    agree(contraction(MUSCLES["elastic"], np.array([L0, 0.75 * L0])), [0.0, 0.25], ROUNDING, scale=1.0)


# --- one potential


@with_and_without_terms
def test_force_is_the_total_derivative_of_the_potential(muscle):
    """At equilibrium the potential may be differentiated along the stretch that follows the length."""
    assert np.all(readings(muscle, P, L).status == Status.OK)

    @jax.jit
    def at_balance(length):
        strain, _ = jax.vmap(muscle.strain)(P, length)
        return jax.vmap(muscle.potential)(length, strain, P)

    slope = difference(lambda k: at_balance(k * L), 1.0, 1e-3) / L
    agree(readings(muscle, P, L).force, slope, BY_DIFFERENCE, scale=P * B0**2)


def maxwell(shows):
    """Return both sides of the Maxwell relation: ∂F/∂P at a length = −∂V/∂L at a pressure."""
    both = jax.jit(jax.vmap(shows))
    by_pressure = difference(lambda k: both(k * P, L)[0], 1.0, 1e-3) / P
    by_length = difference(lambda k: both(P, k * L)[1], 1.0, 1e-3) / L
    agree(by_pressure, -by_length, BY_DIFFERENCE, scale=B0**2)


def shown(muscle):
    def shows(p, l):
        return muscle(p, l).force, muscle.state(l, muscle.strain(p, l)[0]).volume

    return shows


@every
def test_maxwell_relation_holds(muscle):
    maxwell(shown(muscle))


def test_maxwell_relation_detects_a_force_without_a_potential():
    shows = shown(MUSCLES["elastic"])

    def pushed(p, l):
        force, volume = shows(p, l)
        return force - 1e-4 * p * (1 - l / L0), volume  # 70 N in 4 kN, without its volume

    with pytest.raises(AssertionError):
        maxwell(pushed)


# --- derivatives


@with_and_without_terms
def test_derivatives_against_differences(muscle):
    def shows(m, p, l):
        r = readings(m, p, l)
        return np.stack([r.force, r.diameter])

    size = np.stack([P * B0**2, np.full_like(P, 0.1)])
    by_pressure, by_length, *by_number = (np.asarray(s).T for s in slopes(muscle, P, L))
    agree(
        by_pressure,
        difference(lambda k: shows(muscle, k * P, L), 1.0, 1e-3) / P,
        BY_DIFFERENCE,
        scale=size / P,
    )
    agree(
        by_length, difference(lambda k: shows(muscle, P, k * L), 1.0, 5e-4) / L, BY_DIFFERENCE, scale=size / L
    )
    names = list(list_values(muscle))
    # The rest length only defines zero contraction; it does not affect the outputs.
    assert len(names) == len(by_number)
    for name, slope in zip(names, by_number, strict=True):
        value = float(list_values(muscle)[name])
        expected = difference(lambda v: shows(replace_values(muscle, {name: v}), P, L), value, 5e-4 * value)  # noqa: B023
        agree(slope, expected, BY_DIFFERENCE, scale=size / value)


def test_forward_and_reverse_agree():
    for muscle in (MUSCLES["elastic"], MUSCLES["toe"]):
        ways = (jax.tree.leaves(way(muscle, P, L)) for way in (slopes, reverse_slopes))
        for forward, reverse in zip(*ways, strict=True):
            agree(forward, reverse, ROUNDING, scale=1e-9)


@pytest.mark.parametrize("muscle", [MUSCLES["elastic"], MUSCLES["toe"]], ids=["elastic", "toe"])
def test_plain_and_jit_and_vmap_agree(muscle):
    p, l = P[5], L[5]
    for got in (eqx.filter_jit(muscle)(p, l), jax.tree.map(lambda a: a[5], predict(muscle, P, L))):
        for a, b in zip(jax.tree.leaves(got), jax.tree.leaves(muscle(p, l)), strict=True):
            agree(a, b, ROUNDING, scale=1e-3)


# --- every state has finite outputs and a status


def muscle_with(name, share):
    """Return a muscle whose threads are at `share` of their burst limit at rest length and 1 MPa."""
    softer = float(braid.hoop_pull(1e6, L0, B0, N)) / share
    return replace_values(MUSCLES[name], {"thread.stiffness": softer})


@pytest.mark.parametrize("name", list(LAWS)[1:])
@given(
    p=st.sampled_from([0.0, -0.0, 1e6]) | st.floats(-1e9, 1e9),
    l=st.floats(0.0, 10.0),
    share=st.floats(1e-9, 10.0),
)
def test_outputs_are_never_nan(name, p, l, share):
    muscle = muscle_with(name, share)
    at = jnp.array([p]), jnp.array([l])
    r = readings(muscle, *at)
    assert all(np.all(np.isfinite(v)) for v in jax.tree.leaves(r))
    assert all(np.all(np.isfinite(v)) for v in slopes(muscle, *at))
    thread_is_short = bool(l >= r.thread[0])
    at_rest = float(braid.hoop_pull(p, l, B0, N))
    if at_rest > BURST_LOAD_SHARE * float(muscle.thread.stiffness) * (1 + ROUNDING):
        assert r.status[0] == Status.UNSTABLE
    elif at_rest < BURST_LOAD_SHARE * float(muscle.thread.stiffness) * (1 - ROUNDING):
        assert r.status[0] == (Status.STRAIGHT if thread_is_short else Status.OK)
    assert r.strain[0] >= -1e-12


@pytest.mark.parametrize("name", list(LAWS)[1:])
@pytest.mark.parametrize("share", [1e-12, 1e-6, 1e-2, 0.5, 0.97])
def test_equilibrium_is_solved_up_to_the_burst_limit(name, share):
    muscle = muscle_with(name, share)
    r = readings(muscle, np.array([1e6]), np.array([L0]))
    assert r.status[0] == Status.OK
    agree(jax.vmap(muscle.thread.load)(r.strain), r.load, SOLVED, scale=1e-6 * muscle.thread.stiffness)


@pytest.mark.parametrize("name", list(LAWS)[1:])
def test_stretch_is_constant_beyond_the_burst_limit(name):
    held = [
        readings(muscle_with(name, s), np.array([1e6]), np.array([L0])) for s in (0.98 - 1e-12, 1.0, 2.0, 1e3)
    ]
    assert [int(r.status[0]) for r in held] == [Status.OK] + 3 * [Status.UNSTABLE]
    for r in held[1:]:
        agree(r.strain, held[0].strain, SOLVED)


@every
def test_straight_muscle_is_reported(muscle):
    for p, l in ((0.0, B0), (0.0, 0.3), (5e4, 0.3)):
        r = readings(muscle, np.array([p]), np.array([l]))
        assert r.status[0] == Status.STRAIGHT
        assert r.diameter[0] == 0


@every
def test_vacuum_does_not_compress_threads(muscle):
    r = readings(muscle, np.array([-5e4]), np.array([L0]))
    assert r.status[0] == Status.OK
    assert r.strain[0] == 0
    agree(r.force, braid.gaylord_force(-5e4, L0, B0, N), ROUNDING)


@elastic
def test_derivative_of_the_diameter_at_zero_pressure_is_one_sided(muscle):
    """The derivative is the one-sided one, not half of it."""
    (at_zero,) = slopes(muscle, np.array([0.0]), np.array([L0]))[0][:, 1]
    (just_above,) = slopes(muscle, np.array([1.0]), np.array([L0]))[0][:, 1]
    agree(at_zero, just_above, 1e-3)


# --- meanings of the parameters


def test_each_parameter_has_a_meaning():
    for muscle in MUSCLES.values():
        for name, meaning in list_meanings(muscle).items():
            assert meaning.about, name
            assert meaning.source, name
            assert meaning.low < float(list_values(muscle)[name]) < meaning.high, name


def test_inputs_are_broadcast_and_lists_must_have_equal_lengths():
    muscle = MUSCLES["elastic"]
    expected = predict(muscle, [3e5, 3e5], [0.2, 0.22])
    for reading in (predict(muscle, 3e5, [0.2, 0.22]), predict(muscle, [3e5], np.array([0.2, 0.22]))):
        agree(reading.force, expected.force, ROUNDING)
    assert predict(muscle, 3e5, 0.2).force.shape == (1,)
    with pytest.raises(
        BadInput, match=r"must have equal lengths, or one must be a single number; got \(2,\) and \(3,\)"
    ):
        predict(muscle, [1e5, 2e5], [0.2, 0.21, 0.22])


def test_block_size_does_not_change_the_results():
    muscle, states = MUSCLES["elastic"], 4 * CACHE_BLOCK_STATES + 5
    p, l = np.linspace(0, 1e6, states), np.linspace(0.15, 0.2357, states)
    for got, expected in zip(
        *map(jax.tree.leaves, (predict(muscle, p, l), readings(muscle, p, l))), strict=True
    ):
        agree(got, expected, ROUNDING, scale=1e-3)

    def total(way):
        return eqx.filter_jit(eqx.filter_grad(lambda m: jnp.sum(way(m, p, l).force)))(muscle)

    for got, expected in zip(*map(jax.tree.leaves, (total(predict), total(readings))), strict=True):
        agree(got, expected, ROUNDING)


def test_reading_prints_its_values_with_units():
    muscle = Muscle(0.235744, 0.251206, 1.09, LinearThread(144 * 0.0858e-6 * 80e9))
    text = repr(predict(muscle, [689.48e3, 689.48e3], [0.235744, 0.26]))
    assert "  force    4752.8, 6415.3 N" in text
    assert "  diameter 26.498, 0 mm" in text
    assert "  status   0 (1 of 2): solved\n  status   2 (1 of 2): no radius" in text
    assert "Check the units" not in text
    wrong = repr(predict(muscle, [689.48], [235.744]))
    assert wrong.endswith("No value is valid. Check the units: pressure is in Pa and length in m.")
    # A reading inside a compiled function has no values to print.
    assert "ShapeDtypeStruct" in repr(jax.eval_shape(muscle, 1e5, 0.2))
