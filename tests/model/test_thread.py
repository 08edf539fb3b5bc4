"""Common tests of all thread laws: add a new law to `LAWS`."""

import inspect

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from jaxtyping import Array
from scipy.integrate import quad
from scipy.special import erfcx, ndtr

from pamjax.model import thread
from pamjax.model.balance import solve_strain
from pamjax.model.thread import (
    AbstractThread,
    ExponentialToe,
    Inextensible,
    LinearThread,
    RecruitmentToe,
    SmoothToe,
)
from pamjax.parameter import Scalar, list_field_meanings, list_meanings, list_values, replace_values
from tests.agreement import BY_DIFFERENCE, ROUNDING, SOLVED, agree, difference

S = 1e6
LAWS = [
    LinearThread(S),
    SmoothToe(S, toe_ratio=0.4, crimp=0.003, width=8e-4),
    SmoothToe(S, toe_ratio=0.05, crimp=0.012, width=2e-5),
    ExponentialToe(S, crimp=0.004, curvature=400.0),
    ExponentialToe(S, crimp=0.012, curvature=2500.0),
    RecruitmentToe(S, crimp=0.003, spread=1.5e-3),
    RecruitmentToe(S, crimp=0.012, spread=3e-4),
]
KINDS = [LinearThread, SmoothToe, ExponentialToe, RecruitmentToe]
STRAINS = np.array([1e-6, 5e-4, 0.0021, 0.0047, 0.0113, 0.021, 0.08])

#: Parameter values at which a law is linear.
NEUTRAL = [
    SmoothToe(S, toe_ratio=1.0, crimp=0.003, width=8e-4),
    ExponentialToe(S, crimp=0.0, curvature=400.0),
]


def named(items):
    return pytest.mark.parametrize(
        "law", items, ids=[f"{type(law).__name__}{i}" for i, law in enumerate(items)]
    )


# --- properties of every law, as functions of a law, so that a wrong law can be tested


def starts_at_zero(law):
    agree(law.load(jnp.asarray(0.0)), 0.0, ROUNDING, scale=S * 1e-3)
    agree(law.energy(jnp.asarray(0.0)), 0.0, ROUNDING, scale=S * 1e-6)


def rises_and_stiffens(law):
    slope = np.asarray(jax.vmap(jax.grad(law.load))(jnp.linspace(0.0, 0.05, 2001)))
    # A tail of the distribution below the smallest normal number can be negative by rounding.
    assert np.all(slope >= -np.finfo(float).tiny)
    assert np.all(np.diff(slope) >= -ROUNDING * S)


def ends_in_a_line(law):
    far = jnp.asarray(3.0)
    agree(jax.grad(law.load)(far), law.stiffness, BY_DIFFERENCE)
    # A hyperbola approaches its asymptote as w²/ε, an exponential faster.
    agree(law.load(far), law.stiffness * (far - law.slack_strain), BY_DIFFERENCE)


def energy_is_the_area(law):
    corner = float(getattr(law, "crimp", 0.0))
    load = jax.jit(lambda e: law.load(e))
    for strain in STRAINS:
        kinks = [k for k in np.linspace(0.5, 1.5, 11) * corner if 0 < k < strain]
        area, _ = quad(load, 0, strain, points=kinks or None, limit=200, epsabs=0, epsrel=1e-8)
        agree(law.energy(jnp.asarray(strain)), area, BY_DIFFERENCE, scale=S * 1e-10)


def load_is_the_slope_of_energy(law):
    agree(jax.vmap(jax.grad(law.energy))(STRAINS), jax.vmap(law.load)(STRAINS), ROUNDING, scale=S * 1e-4)


def gradient_in_each_number(law):
    @eqx.filter_jit
    def both(numbers):
        changed = replace_values(law, numbers)
        return jnp.stack([jax.vmap(changed.load)(STRAINS), jax.vmap(changed.energy)(STRAINS)])

    slopes = eqx.filter_jit(jax.jacfwd(both))({k: jnp.asarray(v) for k, v in list_values(law).items()})
    for name, meaning in list_meanings(law).items():
        value = float(list_values(law)[name])
        expected = difference(lambda v: both({name: v}), value, 2e-4 * value)  # noqa: B023
        # The energy is a difference of areas up to the corner, which limits its precision.
        size = np.stack([STRAINS, np.maximum(STRAINS**2, 1e-5)])
        agree(slopes[name], expected, BY_DIFFERENCE, scale=S * size / value)
        assert meaning.low <= value <= meaning.high


BATTERY = [
    starts_at_zero,
    rises_and_stiffens,
    ends_in_a_line,
    energy_is_the_area,
    load_is_the_slope_of_energy,
    gradient_in_each_number,
]


@named(LAWS)
@pytest.mark.parametrize("check", BATTERY, ids=lambda f: f.__name__)
def test_thread_law_is_consistent(check, law):
    check(law)


class Softening(AbstractThread):
    """A wrong law: it softens, unlike all others, and its energy is not the integral of its load."""

    stiffness: Scalar

    @property
    def slack_strain(self) -> Array:
        return jnp.asarray(0.0)

    def load(self, strain: Scalar) -> Array:
        return self.stiffness * (1e-3 + strain / (1 + 10 * strain))

    def energy(self, strain: Scalar) -> Array:
        return 0.6 * self.stiffness * (1e-6 + strain**2)


@pytest.mark.parametrize("check", BATTERY[:-1], ids=lambda f: f.__name__)
def test_wrong_law_is_rejected(check):
    with pytest.raises(AssertionError):
        check(Softening(jnp.asarray(S)))


class WrongSlope(Softening):
    """A wrong law: its derivative in the stiffness disagrees with its load."""

    stiffness: Scalar = thread._declare_stiffness()

    def load(self, strain: Scalar) -> Array:
        return jax.lax.stop_gradient(self.stiffness) * strain


def test_wrong_gradient_is_rejected():
    with pytest.raises(AssertionError):
        gradient_in_each_number(WrongSlope(S))


# --- the neutral value, the declared range, the source


@named(NEUTRAL)
def test_neutral_value_gives_the_linear_law(law):
    linear = LinearThread(S)
    agree(jax.vmap(law.load)(STRAINS), jax.vmap(linear.load)(STRAINS), ROUNDING)
    agree(jax.vmap(law.energy)(STRAINS), jax.vmap(linear.energy)(STRAINS), ROUNDING)


def test_neutral_values_agree_with_the_declared_ones():
    for law in NEUTRAL:
        neutral = {k: m.neutral for k, m in list_meanings(law).items() if m.neutral is not None}
        assert neutral == {k: float(list_values(law)[k]) for k in neutral}
        assert neutral


def test_recruitment_becomes_linear_without_slack():
    # No single parameter of this law is neutral: a spread of slack around zero is still a toe.
    law = RecruitmentToe(S, crimp=0.0, spread=1e-5)
    agree(law.load(jnp.asarray(0.02)), S * (0.02 - law.slack_strain), ROUNDING)
    assert float(law.slack_strain) < 5e-6


@pytest.mark.parametrize("kind", KINDS)
def test_each_parameter_has_a_source_and_a_meaning(kind):
    for name, meaning in list_field_meanings(kind).items():
        assert meaning.about, name
        assert meaning.source, name
        assert meaning.low < meaning.high, name
    assert inspect.getdoc(kind)
    assert "Neglects:" in inspect.getdoc(kind) or "not:" in inspect.getdoc(kind)
    assert "Source" in inspect.getdoc(thread)


@st.composite
def laws(draw, kind):
    """Return a law with random parameters in their declared ranges, including the limits."""
    numbers = {}
    for name, m in list_field_meanings(kind).items():
        share = draw(st.sampled_from([0.0, 1.0]) | st.integers(0, 1000).map(lambda i: i / 1000))
        if m.scale == "log":
            numbers[name] = float(np.exp(np.log(m.low) + share * np.log(m.high / m.low)))
        else:
            numbers[name] = m.low + share * (m.high - m.low)
    return kind(**numbers)


@eqx.filter_jit
def compute_all(law, strain):
    by = jax.tree.leaves(eqx.filter_grad(lambda w: w.load(strain))(law))
    return law.load(strain), law.energy(strain), jax.grad(law.load)(strain), law.slack_strain, *by


@pytest.mark.parametrize("kind", KINDS)
@given(data=st.data(), strain=st.sampled_from([0.0, 1e-12]) | st.floats(0, 0.1))
def test_finite_over_the_declared_range(kind, data, strain):
    law = data.draw(laws(kind))
    load, energy, slope, slack, *_ = values = compute_all(law, jnp.asarray(strain))
    assert np.all(np.isfinite(values))
    # Rounding: a law with slack threads up to a sharp corner has about 1e-18 of its stiffness.
    assert load >= -1e-15 * law.stiffness
    assert energy >= -1e-15 * law.stiffness
    assert 0 <= slope <= (1 + ROUNDING) * law.stiffness
    assert -1e-15 <= slack <= 0.03


# --- equilibrium with a pull that increases with thread length


@eqx.filter_jit
def balanced(law, share):
    pull = share * law.stiffness

    def residual(strain):
        return law.load(strain) - pull * (1 + strain)

    strain = solve_strain(residual, law.initial_strain(pull), law.newton_steps)
    return strain, residual(strain) / law.stiffness


@pytest.mark.parametrize("kind", KINDS)
@given(
    data=st.data(),
    share=st.just(0.0)
    | st.floats(-300, 0).map(lambda e: 0.97 * 10.0**e)
    | st.floats(-14, 0).map(lambda e: 0.97 * 10.0**e)
    | st.floats(0, 0.97),
)
def test_newton_converges_over_the_declared_range(kind, data, share):
    strain, left = balanced(data.draw(laws(kind)), jnp.asarray(share))
    assert abs(left) <= SOLVED * max(share, 1e-6)
    assert strain >= -1e-12


@pytest.mark.parametrize(("share", "crimp"), [(0.0, 1.2e-4), (1e-60, 0.015)])
def test_recruitment_converges_at_almost_no_pull(share, crimp):
    _, error = balanced(RecruitmentToe(100.0, crimp=crimp, spread=1e-5), jnp.asarray(share))
    assert abs(error) <= SOLVED * 1e-6


def recruited_by_bisection(share, crimp, spread):
    """Return the strain of recruited filaments by bisection of the logarithm of their recruited strain.

    The logarithm keeps all digits in the far tail of the normal distribution.
    """

    def log_recruited(z):
        below = np.minimum(z, 0.0)
        tail = -0.5 * below**2 + np.log1p(np.sqrt(np.pi / 2) * below * erfcx(-below / np.sqrt(2)))
        beyond = np.maximum(z, 0.0)
        straight = np.log(np.sqrt(2 * np.pi) * beyond * ndtr(beyond) + np.exp(-0.5 * beyond**2))
        return np.where(z < 0, tail, straight) - 0.5 * np.log(2 * np.pi)

    def is_too_large(strain):
        pulled = np.log(share) + np.log1p(strain) - np.log(spread)
        return log_recruited((strain - crimp) / spread) > np.logaddexp(log_recruited(-crimp / spread), pulled)

    low, high = np.zeros_like(share), (share + crimp + spread) / (1 - share)
    assert np.all(is_too_large(high))
    for _ in range(100):
        middle = 0.5 * (low + high)
        above = is_too_large(middle)
        low, high = np.where(above, low, middle), np.where(above, middle, high)
    return low


def random_recruitment(points):
    """Return shares of the stiffness, crimps and spreads over the declared range; some are at its limits."""
    random = np.random.default_rng(7)
    kind = random.integers(0, 4, points)
    exponent = random.uniform(np.where(kind == 1, -300, -14), 0)
    share = np.choose(kind, [0.0 * exponent, 10**exponent, 10**exponent, random.uniform(0, 1, points)]) * 0.97
    crimp = np.where(
        random.random(points) < 0.5, random.uniform(0, 1, points), 10 ** random.uniform(-5, 0, points)
    )
    crimp = 0.015 * np.choose(random.integers(0, 8, points), [0.0 * crimp, 0.0 * crimp + 1, *[crimp] * 6])
    spread = 10 ** np.clip(random.uniform(-5.5, -1.7, points), -5, -2)
    return share, crimp, spread


def test_recruitment_agrees_with_bisection_over_the_declared_range():
    share, crimp, spread = random_recruitment(10_000)

    @jax.jit
    @jax.vmap
    def solved(share, crimp, spread):
        def strain(share):
            return balanced(RecruitmentToe(S, crimp=crimp, spread=spread), share)[0]

        _, error = balanced(RecruitmentToe(S, crimp=crimp, spread=spread), share)
        return strain(share), error, jax.grad(strain)(share), jax.jacfwd(strain)(share)

    strain, error, reverse, forward = map(np.asarray, solved(share, crimp, spread))
    assert np.all(np.abs(error) <= SOLVED * np.maximum(share, 1e-6))
    # Without pull the strain is zero. Its error is the rounding of the crimp and the spread.
    assert np.all(np.abs(strain) <= ROUNDING * (crimp + spread), where=share == 0)
    assert np.all(np.isfinite(reverse))
    agree(forward, reverse, ROUNDING)

    pulled = share > 0
    share, crimp, spread, strain, forward = (x[pulled] for x in (share, crimp, spread, strain, forward))
    expected = recruited_by_bisection(share, crimp, spread)
    agree(strain, expected, SOLVED, scale=spread)
    agree(forward, (1 + expected) / (ndtr((expected - crimp) / spread) - share), SOLVED)


def test_fewer_newton_steps_are_not_sufficient():
    """The number of steps of a law is necessary: the test above can fail."""
    for kind, worst in ((ExponentialToe, {"curvature": 600.0}), (RecruitmentToe, {"spread": 8e-3})):
        law = kind(stiffness=S, crimp=0.015, **worst)
        pull = 1e-6 * S

        def residual(strain, law=law, pull=pull):
            return law.load(strain) - pull * (1 + strain)

        left = [
            abs(float(residual(solve_strain(residual, law.initial_strain(pull), n)))) / pull
            for n in (1, law.newton_steps)
        ]
        assert left[0] > SOLVED > left[1]


def test_inextensible_threads_store_no_energy():
    assert float(Inextensible().energy(jnp.asarray(0.01))) == 0.0
