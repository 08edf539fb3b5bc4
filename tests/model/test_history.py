"""Rates, increments and delays do not cross the gaps of a recording."""

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from pamjax.model.bench import Bench, record_bench
from pamjax.model.history import build_time_history
from pamjax.model.mechanisms.braid_elasticity import BraidElasticity
from pamjax.model.mechanisms.braid_friction import BraidFriction
from pamjax.model.mechanisms.mullins_softening import MullinsSoftening
from pamjax.model.mechanisms.thread_slip import ThreadSlip
from pamjax.model.mechanisms.viscoelastic_creep import ViscoelasticCreep
from pamjax.model.mechanisms.viscous_damping import ViscousDamping
from tests.agreement import ROUNDING, SOLVED, agree

TIME = np.r_[np.cumsum(np.tile([0.4, 0.6, 0.5], 20)), 500 + 0.5 * np.arange(40)]
STARTS = np.isin(np.arange(100), [0, 60])
PAST = build_time_history(TIME, STARTS)


def test_rate_is_exact_on_both_sides_of_a_gap():
    values = np.where(TIME < 400, 3 * TIME, 7 - 2 * TIME)
    agree(PAST.rate(jnp.asarray(values)), np.where(TIME < 400, 3.0, -2.0), 1e-11)


def test_increments_cross_a_gap_unless_memory_restarts():
    agree(PAST.increments(jnp.asarray(TIME)), np.diff(TIME, prepend=TIME[0]), ROUNDING)
    anew = build_time_history(TIME, STARTS, restart=True).increments(jnp.asarray(TIME))
    assert anew[0] == anew[60] == 0


def test_zero_lag_changes_nothing():
    values = jnp.asarray(np.random.default_rng(0).normal(size=100))
    assert np.array_equal(PAST.delay(values, jnp.asarray(0.0)), values)


def test_lag_of_a_straight_line_is_exact():
    for lag in (0.3, -0.7, 1.9):
        late = np.asarray(PAST.delay(jnp.asarray(3 * TIME), jnp.asarray(lag)))
        inside = np.r_[10:50, 70:95]
        agree(late[inside], 3 * (TIME - lag)[inside], 1e-11)


def test_lag_does_not_cross_a_gap():
    values = np.where(TIME < 400, 1.0, 2.0)
    for lag in (5.0, -5.0, 1e3, -1e3):
        agree(PAST.delay(jnp.asarray(values), jnp.asarray(lag)), values, ROUNDING)


def test_lag_of_a_wave_is_accurate_to_a_thousandth():
    late = PAST.delay(jnp.asarray(np.sin(TIME / 3)), jnp.asarray(0.77))
    inside = np.r_[10:50, 70:95]
    agree(np.asarray(late)[inside], np.sin((TIME - 0.77) / 3)[inside], 3e-3, 1.0)


def test_derivative_in_the_lag_is_minus_the_rate():
    values = jnp.asarray(np.random.default_rng(0).normal(size=100))

    def slope(lag):
        return jax.jvp(lambda lag: PAST.delay(values, lag), (jnp.asarray(lag),), (jnp.ones(()),))[1]

    inside = np.r_[2:58, 62:98]
    for lag in (1e-9, -1e-9):
        agree(slope(lag)[inside], -PAST.rate(values)[inside], 1e-6, 1.0)


def test_static_map_has_no_rate_and_no_lag():
    still = build_time_history(None, np.arange(5) == 0)
    values = jnp.asarray([3.0, 1.0, 4.0, 1.0, 5.0])
    assert not np.any(still.rate(values))
    assert not np.any(still.increments(values))
    assert np.array_equal(still.delay(values, jnp.asarray(2.0)), values)


def test_padding_changes_no_sample():
    values, padded = np.sin(TIME), build_time_history(TIME, STARTS, size=128)
    long = jnp.asarray(np.r_[values, np.full(28, values[-1])])
    agree(padded.rate(long)[:100], PAST.rate(jnp.asarray(values)), ROUNDING, 1.0)
    lag = jnp.asarray(0.8)
    agree(padded.delay(long, lag)[:100], PAST.delay(jnp.asarray(values), lag), ROUNDING, 1.0)
    assert np.all(np.isfinite(padded.delay(long, lag)))


@pytest.mark.slow
def test_settled_muscle_starts_with_the_memory_of_one_pass():
    """Reference: the second pass of a recording that is repeated. Outputs without memory are unchanged."""
    kinds = BraidElasticity(1e-6), BraidFriction(0.2, 3.0), ViscoelasticCreep(5e4), ThreadSlip(1e-3)
    bench = Bench(0.2512, 1.09, (*kinds, MullinsSoftening(5e4), ViscousDamping(1e3)))
    pressure, length = 3e5 + 1e5 * np.sin(TIME / 7), 0.22 - 0.02 * np.cos(TIME / 11)
    at = jnp.asarray(pressure), jnp.asarray(length)
    settled = record_bench(bench, *at, build_time_history(TIME, STARTS, settled=True)).force
    time = np.r_[TIME - np.ptp(TIME), TIME]
    twice = build_time_history(time, np.r_[STARTS, STARTS])
    agree(settled, record_bench(bench, *(jnp.r_[x, x] for x in at), twice).force[100:], SOLVED, 100.0)
    assert np.max(np.abs(settled - record_bench(bench, *at, PAST).force)) > 5.0
    padded = jnp.r_[at[0], jnp.full(28, at[0][-1])], jnp.r_[at[1], jnp.full(28, at[1][-1])]
    long = build_time_history(TIME, STARTS, settled=True, size=128)
    agree(record_bench(bench, *padded, long).force[:100], settled, SOLVED, 100.0)


@pytest.mark.slow
@pytest.mark.parametrize("settled", [False, True])
def test_skipped_padding_changes_no_sample(settled):
    """300 rows in a program of 700: two of three blocks are computed, the third is padding."""
    rows, size = 300, 700
    time = np.arange(float(rows))
    first, fill = time == 0, np.full(size - rows, np.nan)
    pressure = jnp.asarray(np.r_[3e5 + 1e5 * np.sin(time / 7), fill])
    length = jnp.asarray(np.r_[0.22 - 0.02 * np.cos(time / 11), fill])

    def force(coefficient, padding):
        n = size if not padding else rows
        kinds = BraidElasticity(1e-6), BraidFriction(coefficient, 3.0), ViscoelasticCreep(5e4)
        past = build_time_history(time, first, settled=settled, size=n, compute_padding=padding)
        return Bench(0.2512, 1.09, kinds)(pressure[:n], length[:n], past).force

    @partial(jax.jit, static_argnums=0)
    def both(padding):
        return jax.jvp(lambda c: force(c, padding), (jnp.asarray(0.2),), (jnp.ones(()),))

    exact = both(True)
    for cut, whole in zip(both(False), exact, strict=True):
        agree(cut[:rows], whole, SOLVED, 100.0)
        assert np.all(np.isfinite(cut))
    # Negative control: the memory has an effect, which depends on the earlier history.
    assert np.max(np.abs(exact[1])) > 1.0


def test_static_map_has_no_settled_state():
    for size in (5, 8):
        twice = build_time_history(None, np.ones(5, bool), settled=True, size=size).repeat()
        assert np.all(twice.restart)


def strokes(corner):
    """Return rates with a corner between samples 20 and 21, and noise in another channel."""
    time, noise = np.arange(41.0), np.random.default_rng(3).normal(size=(2, 41))
    way = -np.abs(time - 20 - corner)
    past = build_time_history(
        time, time == 0, stroke_channels=np.stack([way + 0.02 * noise[0], 1e3 * noise[1]])
    )
    return np.asarray(past.rate(jnp.asarray(way)))


def test_rate_does_not_cross_a_corner():
    rate = strokes(0.5)
    agree(rate[:21], np.full(21, 1.0), ROUNDING)
    agree(rate[21:], np.full(20, -1.0), ROUNDING)


def test_sample_at_a_corner_has_zero_rate():
    rate = strokes(0.0)
    agree(rate[:20], np.full(20, 1.0), ROUNDING)
    agree(rate[20], 0.0, ROUNDING)
    agree(rate[21:], np.full(20, -1.0), ROUNDING)


def test_rate_without_a_corner_uses_five_samples():
    time = np.arange(41.0)
    rate = build_time_history(time, time == 0).rate(jnp.asarray(-np.abs(time - 20.5)))
    assert abs(float(rate[20])) < 0.5
