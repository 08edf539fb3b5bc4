"""Recurrences in blocks agree with loops, also in their derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pamjax.model import scan
from tests.agreement import BY_DIFFERENCE, ROUNDING, SOLVED, agree

running_max, relax, stops = (
    jax.jit(scan.running_max),
    jax.jit(scan.relax_states),
    jax.jit(scan.apply_stop_operator),
)


def given(n, k=2):
    rng = np.random.default_rng(n)
    restart = rng.uniform(size=n) < 0.03
    return rng.normal(size=(n, k)), rng.uniform(0.3, 1.5, size=(n, k)), restart


def loop(step, first, restart, *rows):
    """Return the result of the recurrence by a loop."""
    out, s = [], None
    for i, row in enumerate(zip(*rows, strict=True)):
        s = first(*row) if restart[i] or s is None else step(s, *row)
        out.append(s)
    return np.array(out)


def drag(moved, width, restart, start):
    def step(s, m, w):
        return np.clip(s + np.array([2.0, 0.7]) * m, -w, w)

    restart = restart | (np.arange(len(moved)) == 0)
    return loop(step, lambda m, w: start * w, restart, moved, width)


@pytest.mark.parametrize("n", [1, 17, 300])
def test_running_maximum_agrees_with_a_loop(n):
    values, _, restart = given(n)
    agree(running_max(values, restart), loop(np.maximum, lambda v: v, restart, values), 0)


@pytest.mark.parametrize("n", [1, 17, 300])
def test_relaxation_agrees_with_a_loop(n):
    kicks, keep, restart = given(n)
    expected = loop(lambda s, x, a: a * s + x, lambda x, a: x, restart, kicks, keep)
    agree(relax(kicks, keep, restart), expected, ROUNDING, 1.0)


@pytest.mark.parametrize("n", [1, 17, 300])
@pytest.mark.parametrize("start", [0.0, -0.6])
def test_stop_operator_agrees_with_a_loop(n, start):
    moved, width, restart = given(n)
    restart[0] = True
    stopped = stops(moved[:, 0], jnp.array([2.0, 0.7]), width, restart, start * width)
    agree(stopped, drag(moved[:, 0], width, restart, start), ROUNDING, 1.0)


def test_stop_operator_may_have_another_limit_on_each_side():
    moved, width, restart = given(300)
    restart[0] = True

    def step(s, m, w):
        return np.clip(s + np.array([2.0, 0.7]) * m, -0.3 * w, w)

    expected = loop(step, lambda m, w: 0.2 * w, restart, moved[:, :1], width)
    stopped = stops(moved[:, 0], jnp.array([2.0, 0.7]), width, restart, 0.2 * width, -0.3 * width)
    agree(stopped, expected, ROUNDING, 1.0)
    assert np.min(expected / width) < -0.29
    assert np.max(expected / width) > 0.99


def test_stop_operator_starts_at_zero():
    moved, width, _ = given(40)
    stopped = stops(moved[:, 0], jnp.array([2.0, 0.7]), 9 * width, np.zeros(40, bool))
    nothing, first = np.zeros((1,)), np.zeros((1, 2))
    longer = drag(np.r_[nothing, moved[:, 0]], np.r_[first, 9 * width], np.zeros(41, bool), 0.0)
    agree(stopped, longer[1:], ROUNDING, 1.0)


def test_stop_operator_without_sliding_follows_its_input():
    moved, width, _ = given(40)
    free = lambda m: stops(m, jnp.ones(2), 1e9 * width, np.zeros(40, bool))  # noqa: E731
    tangent = jax.jit(lambda: jax.jvp(free, (moved[:, 0],), (moved[:, 1],))[1])()
    agree(tangent[:, 0], np.cumsum(moved[:, 1]), ROUNDING, 1.0)


def recurrences(restart):
    return {
        "running_max": lambda a, b: running_max(a, restart),
        "relax": lambda a, b: relax(a, b, restart),
        "stops": lambda a, b: stops(a[:, 0], jnp.array([2.0, 0.7]), b, restart, 0.3 * b),
        "uneven": lambda a, b: stops(a[:, 0], jnp.array([2.0, 0.7]), b, restart, 0.3 * b, -0.4 * b),
    }


@pytest.mark.parametrize("name", ["running_max", "relax", "stops", "uneven"])
def test_tangents_agree_with_differences_and_reverse_mode(name):
    a, b, restart = given(200)
    rng = np.random.default_rng(5)
    da, db, weight = rng.normal(size=a.shape), rng.normal(size=b.shape), rng.normal(size=a.shape)
    function, h = recurrences(restart)[name], 1e-6
    tangent = jax.jit(lambda: jax.jvp(function, (a, b), (da, db))[1])()
    by_difference = (function(a + h * da, b + h * db) - function(a - h * da, b - h * db)) / (2 * h)
    agree(tangent, by_difference, BY_DIFFERENCE, 1.0)
    by_a, by_b = jax.jit(lambda a, b: jax.vjp(function, a, b)[1](jnp.asarray(weight)))(a, b)
    agree(np.sum(by_a * da) + np.sum(by_b * db), np.sum(weight * tangent), SOLVED)
