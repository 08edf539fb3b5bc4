"""The map between bounded parameters and the real line, and its priors."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pamjax.errors import BadInput
from pamjax.infer.problem.parameter_space import FreeParameter, build_space
from pamjax.parameter import Meaning
from tests.agreement import BY_DIFFERENCE, ROUNDING, agree, difference


def number(name="a", start=2.0, sd=np.inf, low=0.5, high=9.0, scale="linear"):
    return FreeParameter(name, Meaning("1", "1", low, high, scale, "a number", "here"), start, sd)


TWO = build_space([number("line", -1.0, 0.3, -4.0, 5.0), number("log", 30.0, 4.0, 1e-3, 1e4, "log")])
UNKNOWN = build_space([number("line", 2.0), number("log", 3.0, low=1e-2, high=1e3, scale="log")])


@given(st.floats(-3.99, 4.99), st.floats(-6.9, 9.2))
def test_map_is_invertible(line, log):
    values = {"line": line, "log": float(np.exp(log))}
    agree(TWO.to_values(TWO.to_point(values)), list(values.values()), 1e-9, scale=1e-2)


@jax.jit
def everything(at, u):
    return (
        at.to_values(u),
        at.compute_prior_residual(u),
        jax.jacfwd(at.compute_prior_residual)(u),
        jax.jacrev(at.compute_prior_residual)(u),
        jax.jacrev(at.to_values)(u),
    )


@given(st.floats(-1e3, 1e3), st.floats(-1e3, 1e3))
def test_values_stay_within_limits_with_finite_slopes(a, b):
    for at in (TWO, UNKNOWN):
        values, *finite = everything(at, jnp.array([a, b]))
        assert np.all((values >= at.low) & (values <= at.high))
        assert all(np.isfinite(array).all() for array in finite)


def test_origin_is_the_stated_value():
    agree(TWO.to_values(jnp.zeros(2)), [-1.0, 30.0], ROUNDING)
    agree(TWO.compute_prior_residual(jnp.zeros(2)), [0.0, 0.0], ROUNDING, scale=1.0)


def test_unit_step_is_about_one_standard_deviation():
    slope = jax.jvp(TWO.to_values, (jnp.zeros(2),), (jnp.ones(2),))[1]
    agree(slope, [0.3, 4.0], ROUNDING)
    agree(TWO.compute_prior_residual(TWO.to_point({"line": -0.7, "log": 34.0})), [1.0, 1.0], 1e-9)


@pytest.mark.parametrize("name", ["line", "log"])
def test_default_prior_is_uniform_on_the_scale_of_the_parameter(name):
    def position(value):
        low, high = (0.5, 9.0) if name == "line" else (1e-2, 1e3)
        return (value - low) / (high - low) if name == "line" else np.log(value / low) / np.log(high / low)

    def density(u):
        """Return the density of u for a uniform position: its slope."""
        k = UNKNOWN.names.index(name)
        at = jnp.zeros(2).at[k].set(u)
        return difference(
            lambda v: position(float(UNKNOWN.to_values(jnp.zeros(2).at[k].set(v))[k])), u, 1e-3
        ), float(UNKNOWN.compute_prior_residual(at)[k])

    (first, r), (second, s) = density(0.4), density(-1.3)
    agree(0.5 * (s**2 - r**2), np.log(first / second), BY_DIFFERENCE, scale=1.0)


def test_default_prior_is_continuous():
    # The formula of its root changes for small z.
    residual = jax.jit(lambda u: UNKNOWN.compute_prior_residual(jnp.zeros(2).at[0].set(u))[0])
    for z in (-0.0101, -0.0099, 0.0, 0.0099, 0.0101):
        u = float((z - UNKNOWN.origin[0]) / UNKNOWN.width[0])
        agree(jax.grad(residual)(u), difference(residual, u, 1e-4), BY_DIFFERENCE)


def test_parameters_at_a_limit_are_named():
    assert TWO.find_names_at_bound(jnp.zeros(2)) == []
    assert TWO.find_names_at_bound(jnp.array([1e3, 0.0])) == ["line"]
    assert TWO.find_names_at_bound(jnp.array([0.0, -1e3])) == ["log"]


def test_duplicate_names_are_refused():
    with pytest.raises(BadInput, match="free parameters need different names; got 'a' twice"):
        build_space([number(), number()])


def test_start_outside_its_limits_is_refused():
    with pytest.raises(BadInput, match=r"`a` must be between 0\.5 and 9; got 12\."):
        number(start=12.0)
