"""The equilibrium solver agrees with closed forms, other root finders, and the printed equations."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from pamjax.model import braid
from pamjax.model.balance import BURST_LOAD_SHARE, Status, solve_strain, stretch_linear, stretch_measured
from pamjax.model.thread import RecruitmentToe, SmoothToe
from tests.agreement import BY_DIFFERENCE, ROUNDING, SOLVED, agree, difference

# The 22.2 mm Kevlar muscle of Chambers & Wereley at rest length and 100 psi.
L, B0, N, P = 0.235744, 0.251206, 1.09, 689.48e3
S = 144 * 0.0858e-6 * 80e9
BLOCKED = 4701.0

lengths = st.floats(0.05, 0.25)
pressures = st.just(0.0) | st.floats(1.0, 2e6)
stiffnesses = st.floats(4, 9).map(lambda e: 10.0**e)


linear = jax.jit(stretch_linear)
measured = jax.jit(stretch_measured)
gaylord = jax.jit(braid.gaylord_force)
slopes_of_measured = jax.jit(jax.grad(lambda *a: stretch_measured(*a)[0], argnums=(0, 1, 2, 3, 4, 5)))


def share_of_burst(p, l, s):
    return p * l * B0 / (2 * np.pi * N**2 * s)


# --- linear threads: closed form, cubic and Newton agree


@given(pressures, lengths, stiffnesses)
def test_closed_form_solves_the_cubic(p, l, s):
    x = share_of_burst(p, l, s)
    assume(x < BURST_LOAD_SHARE)
    strain, status = linear(x * s, s)
    assert status == Status.OK
    b = B0 * (1 + float(strain))
    again, status = measured(gaylord(p, l, b, N), p, l, B0, N, s)
    # If the cubic decreases at the closed form, this is its smallest root.
    slope = x * (1 + (b / l) ** 2) - 1
    assume(abs(slope) > 1e-3)
    if slope < 0:
        assert status == Status.OK
        agree(again, strain, SOLVED, scale=1e-3)
    else:
        assert again < strain


@given(st.floats(0, 1.2), lengths)
def test_closed_form_is_a_root_of_the_cubic_up_to_the_burst(x, l):
    p = x * 2 * np.pi * N**2 * S / (l * B0)
    strain, status = linear(x * S, S)
    assert status == (Status.OK if x <= BURST_LOAD_SHARE else Status.UNSTABLE)
    assume(x < 0.97)
    b = B0 * (1 + float(strain))
    k = B0 / (l * S)
    force = float(gaylord(p, l, b, N))
    terms = [
        b**3 * k * p / (4 * np.pi * N**2),
        b * k * force,
        -b * k * l**2 * p / (4 * np.pi * N**2),
        -b,
        B0,
    ]
    agree(sum(terms), 0.0, ROUNDING, scale=max(map(abs, terms)))


@given(pressures, lengths, stiffnesses, st.floats(-500, 5000))
def test_cubic_is_the_smallest_positive_root(p, l, s, force):
    k = B0 / (l * s)
    cubic = [k * p / (4 * np.pi * N**2), 0, k * (force - l**2 * p / (4 * np.pi * N**2)) - 1, B0]
    assume(cubic[0] == 0 or cubic[0] > 1e-9)
    roots = np.roots(cubic)
    real = np.sort(roots[(abs(roots.imag) < 1e-9 * abs(roots)) & (roots.real > 0)].real)
    # Near the fold two roots coincide, and both programs lose half their digits.
    fold = 27 * cubic[0] * B0**2 / max(4 * -(cubic[2] ** 3), 1e-300)
    assume(not 0.999 < fold < 1.001)
    strain, status = measured(force, p, l, B0, N, s)
    assert (status == Status.OK) == bool(real.size)
    if real.size:
        agree(B0 * (1 + strain), real[0], SOLVED)


@pytest.mark.parametrize("share", np.linspace(0.0, 1.0, 21))
def test_cubic_up_to_its_fold(share):
    """At the fold v = 4/27 the root is 3/2; elsewhere the parametrisation v = (c − 1)/c³ gives it."""
    c = 1 + 0.5 * share
    v = (c - 1) / c**3
    # Unit braid: length 1, stiffness 1, and a force that makes d = m.
    p = 4 * np.pi * v
    strain, status = stretch_measured(v, p, 1.0, 1.0, 1.0, 1.0)
    assert status == (Status.OK if share < 1 else status)
    agree(1 + strain, c, SOLVED if share < 0.99 else 1e-7)


@jax.jit
def by_newton(x):
    law = SmoothToe(S, toe_ratio=1.0, crimp=0.003, width=1e-3)
    # Start from twice the strain instead of `start`, which is the closed form itself.
    return solve_strain(lambda strain: law.load(strain) - x * S * (1 + strain), 2 * x / (1 - x))


@given(st.floats(0, BURST_LOAD_SHARE))
def test_newton_agrees_with_the_closed_form(x):
    agree(by_newton(x), linear(x * S, S)[0], SOLVED, scale=1e-6)


# --- the printed equations give other values: their corrections are necessary


def test_equation_10_needs_its_minus():
    radius_squared = float(braid.radius_squared(L, B0, N))
    share = B0 * (BLOCKED + P * np.pi * radius_squared) / (L * S)
    assert 1e3 * B0 / (1 + share) == pytest.approx(249.85, abs=0.005)  # as printed: a pull shortens
    assert 1e3 * B0 / (1 - share) == pytest.approx(252.58, abs=0.005)


def test_equation_11_needs_its_bracket():
    k = B0 / (L * S)
    per_area = P / (4 * np.pi * N**2)
    as_printed = np.roots([k * per_area, 0, k * (BLOCKED - L**2 * per_area - 1), B0])
    positive = as_printed[(abs(as_printed.imag) < 1e-9) & (as_printed.real > 0)]
    assert positive.size == 0
    mended = np.roots([k * per_area, 0, k * (BLOCKED - L**2 * per_area) - 1, B0])
    positive = mended[(abs(mended.imag) < 1e-9) & (mended.real > 0)].real.min()
    assert 1e3 * positive == pytest.approx(252.59, abs=0.005)
    strain, _ = stretch_measured(BLOCKED, P, L, B0, N, S)
    agree(B0 * (1 + strain), positive, SOLVED)


# --- derivatives


LAW = SmoothToe(S, toe_ratio=0.4, crimp=0.004, width=1e-3)


def toe_strain(log_stiffness, crimp, pull, law=LAW, steps=3):
    law = SmoothToe(S * jnp.exp(log_stiffness), law.toe_ratio, crimp, law.width)

    def residual(strain):
        return law.load(strain) - pull * (1 + strain)

    return solve_strain(residual, jax.lax.stop_gradient(law.initial_strain(pull)) * 1.01, steps)


def unrolled(log_stiffness, crimp, pull):
    """Return the result of the same Newton steps, differentiated through the steps."""
    law = SmoothToe(S * jnp.exp(log_stiffness), LAW.toe_ratio, crimp, LAW.width)

    def residual(strain):
        return law.load(strain) - pull * (1 + strain)

    strain = jax.lax.stop_gradient(law.initial_strain(pull)) * 1.01
    for _ in range(3):
        strain = strain - residual(strain) / jax.grad(residual)(strain)
    return strain


AT = (0.1, 0.004, 6e3)
ALL = (0, 1, 2)


both_ways = [
    jax.jit(way(f, ALL))
    for f, way in ((toe_strain, jax.grad), (unrolled, jax.grad), (toe_strain, jax.jacfwd))
]


@pytest.mark.parametrize("pull", [1e2, 3e3, 6e3, 5e4])
def test_implicit_derivative_agrees_with_the_unrolled_steps(pull):
    reverse, through, forward = (way(0.1, 0.004, pull) for way in both_ways)
    agree(reverse, through, SOLVED)
    agree(forward, reverse, ROUNDING)


def test_first_and_second_derivatives_against_differences():
    @jax.jit
    def orders(*at):
        slope = jax.grad(toe_strain, ALL)
        return (
            toe_strain(*at),
            jnp.stack(slope(*at)),
            jax.jacfwd(slope, ALL)(*at),
            jax.jacrev(slope, ALL)(*at),
        )

    def along(number, order):
        return lambda v: orders(*AT[:number], v, *AT[number + 1 :])[order]

    _, slope, forward, reverse = orders(*AT)
    agree(np.array(forward), np.array(reverse), ROUNDING)
    for number, at in enumerate(AT):
        agree(slope[number], difference(along(number, 0), at, 2e-3 * at), BY_DIFFERENCE)
        agree(np.array(forward)[number], difference(along(number, 1), at, 2e-3 * at), BY_DIFFERENCE)


slope_of_linear = jax.jit(jax.grad(lambda p: stretch_linear(p, S)[0]))


@given(st.floats(0, 0.9))
def test_closed_form_derivative(x):
    slope = slope_of_linear(x * S)
    agree(slope * S, 1 / (1 - x) ** 2, ROUNDING)


def test_derivative_at_zero_pressure_is_one_sided():
    agree(slope_of_linear(0.0), 1 / S, ROUNDING)


@pytest.mark.parametrize("number", range(6))
def test_cubic_derivative_against_differences(number):
    at = (BLOCKED, P, L, B0, N, S)

    def along(v):
        return measured(*at[:number], v, *at[number + 1 :])[0]

    reverse = slopes_of_measured(*at)[number]
    agree(reverse, difference(along, at[number], 1e-3 * at[number]), BY_DIFFERENCE)
    agree(jax.jacfwd(along)(at[number]), reverse, ROUNDING)


def test_jit_vmap_and_plain_results_agree():
    at = (0.0, 0.004, 0.01 * S)
    mapped = jax.jit(jax.vmap(toe_strain))(*(jnp.full(2, a) for a in at))
    agree(mapped, toe_strain(*at), ROUNDING)
    at = (1e3, P, L, B0, N, S)
    mapped = jax.jit(jax.vmap(stretch_measured))(*(jnp.full(2, a) for a in at))[0]
    agree(mapped, stretch_measured(*at)[0], ROUNDING, scale=1e-3)


# --- failures are reported as a status


def test_force_without_a_solution_is_reported():
    strain, status = stretch_measured(1e9, P, L, B0, N, S)
    assert status == Status.UNSTABLE
    assert np.isfinite(strain)


@given(
    force=st.floats(-1e6, 1e6),
    p=st.just(0.0) | st.floats(-1e7, 1e8),
    l=st.just(0.0) | st.floats(1e-6, 10),
    s=st.floats(1e2, 1e9),
    n=st.floats(0.05, 100),
)
def test_cubic_never_returns_nan(force, p, l, s, n):
    strain, status = measured(force, p, l, B0, n, s)
    assert np.isfinite(strain)
    assert np.all(np.isfinite(slopes_of_measured(force, p, l, B0, n, s)))
    assert status in (Status.OK, Status.UNSTABLE)


def test_newton_stops_if_the_function_does_not_increase():
    law = RecruitmentToe(S, crimp=0.015, spread=1e-5)
    value, slope = jax.value_and_grad(lambda p: solve_strain(lambda e: law.load(e) - p, jnp.asarray(0.0)))(
        1.0
    )
    assert np.isfinite(value)
    assert np.isfinite(slope)


def test_every_status_has_a_description():
    assert {s.message for s in Status} == {
        "solved",
        "no equilibrium: the threads stretch without limit at this pressure",
        "no radius: the muscle is longer than its threads",
        "not converged: the error of the thread balance exceeds its tolerance",
    }


@pytest.mark.parametrize(("slope", "expected"), [(2.0, 0.5), (0.0, 0.0), (1e-304, 0.0)])
def test_derivative_is_finite_where_the_load_hardly_rises(slope, expected):
    """A GPU keeps slopes near the smallest number, by which the division of a pull overflows."""

    def strain(pull):
        return solve_strain(lambda strain: slope * strain - pull, jnp.asarray(0.0))

    for differentiate in (jax.grad, jax.jacfwd):
        assert float(differentiate(lambda x: strain(1e6 * x))(0.0)) == expected * 1e6
