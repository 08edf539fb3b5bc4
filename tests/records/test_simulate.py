"""A simulated recording is the muscle's answer with the noise it was given, and nothing else."""

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from pamjax.model.bench import Bench
from pamjax.model.mechanisms.channel_lag import ChannelLag
from pamjax.model.muscle import Muscle, predict
from pamjax.model.thread import LinearThread
from pamjax.records.protocol import Protocol
from pamjax.records.reading.muscle_toml import Sensors
from pamjax.records.simulate import describe_extrapolation, draw_ar1_noise, renumber_rows, simulate
from tests.agreement import ROUNDING, agree

MUSCLE = Muscle(0.2, 0.214, 1.2, LinearThread(5e5))
PLAN = Protocol(kind="strokes", pressures=["1 bar", "3 bar"], contractions=[0.2], speed="0.1 mm/s")
SCHEDULE = PLAN.build_schedule(0.2)
SENSORS = Sensors(force=2.0, diameter=5e-5, pressure=700.0, length=2e-5)


@pytest.fixture(scope="module")
def exact():
    return simulate(MUSCLE, SCHEDULE, Sensors())


def test_without_sensors_it_is_what_the_muscle_shows(exact):
    reading = predict(MUSCLE, SCHEDULE.pressure, SCHEDULE.length)
    agree(exact.force, reading.force, ROUNDING)
    agree(exact.diameter, reading.diameter, ROUNDING)
    np.testing.assert_array_equal(exact.length, SCHEDULE.length)


def test_each_channel_has_its_own_noise(exact):
    noisy = simulate(MUSCLE, SCHEDULE, SENSORS, seed=1)
    n = noisy.n
    for channel in ("force", "diameter", "pressure", "length"):
        off = getattr(noisy, channel) - getattr(exact, channel)
        sd = getattr(SENSORS, channel)
        assert np.std(off) == pytest.approx(sd, rel=5 / np.sqrt(2 * n))
        assert abs(np.mean(off)) < 5 * sd / np.sqrt(n)


def test_the_noise_is_the_seeds():
    first, again, other = (simulate(MUSCLE, SCHEDULE, SENSORS, seed=s) for s in (1, 1, 2))
    np.testing.assert_array_equal(first.force, again.force)
    assert np.all(first.force != other.force)


@pytest.mark.parametrize("keep", [0.0, 0.5, 0.95])
def test_coloured_noise_keeps_its_variance_and_its_share(keep):
    noise = draw_ar1_noise(np.random.default_rng(0), 200_000, keep)
    worth = (1 + keep) / (1 - keep)
    assert np.var(noise) == pytest.approx(1.0, abs=5 * np.sqrt(2 * worth / 200_000))
    assert np.mean(noise[1:] * noise[:-1]) == pytest.approx(keep, abs=5 * np.sqrt(2 * worth / 200_000))


def test_a_correlation_time_is_in_seconds(exact):
    noisy = simulate(MUSCLE, SCHEDULE, Sensors(force=2.0), correlation_time=5.0)
    off = noisy.force - exact.force
    lag_one = np.mean(off[1:] * off[:-1]) / np.mean(off**2)
    assert lag_one == pytest.approx(np.exp(-1 / 5), abs=0.06)


def test_one_error_of_the_ruler_for_each_setting():
    plan = Protocol(kind="ramps", pressures=["3 bar"], contractions=[0.0, 0.1, 0.2])
    sensors = Sensors(length=1e-3, length_per_setting=True)
    schedule = plan.build_schedule(0.2)
    written = simulate(MUSCLE, schedule, sensors, seed=3)
    errors = (written.length - schedule.length).reshape(3, -1)
    agree(np.ptp(errors, axis=1), 0.0, 1e-15, scale=1.0)
    assert np.unique(errors[:, 0]).size == 3
    # What it pulls is what it pulls at the true length.
    agree(written.force, predict(MUSCLE, schedule.pressure, schedule.length).force, ROUNDING)


def test_what_the_muscle_cannot_show_is_not_measured():
    deep = Protocol(kind="strokes", pressures=["3 bar"], contractions=[0.5]).build_schedule(0.2)
    force = simulate(MUSCLE, deep, SENSORS).force
    would_push = np.asarray(predict(MUSCLE, deep.pressure, deep.length).force) < 0
    np.testing.assert_array_equal(np.isnan(force), would_push)
    long = Protocol(kind="strokes", pressures=["3 bar"], contractions=[-0.1]).build_schedule(0.2)
    assert np.isnan(simulate(MUSCLE, long, SENSORS).diameter).any()


def test_photographs_are_taken_now_and_then():
    plan = dataclasses.replace(SCHEDULE, diameter_measured=np.arange(SCHEDULE.time.size) % 5 == 0)
    seen = np.isfinite(simulate(MUSCLE, plan, SENSORS).diameter)
    np.testing.assert_array_equal(seen, plan.diameter_measured)


def test_a_bench_without_mechanisms_shows_what_the_muscle_does():
    rigid = Muscle(0.2, 0.214, 1.2)
    bench = Bench(jnp.asarray(0.214), jnp.asarray(1.2), ())
    mine, theirs = (simulate(m, SCHEDULE, SENSORS, seed=4) for m in (rigid, bench))
    agree(mine.force, theirs.force, 1e-9, scale=1.0)


def test_nothing_is_late_across_the_step_between_two_isobars():
    late = Bench(jnp.asarray(0.214), jnp.asarray(1.2), (ChannelLag(lag=jnp.asarray(1.7)),))
    both, second = simulate(late, SCHEDULE, Sensors()), SCHEDULE.pressure > 2e5
    alone = dataclasses.replace(
        SCHEDULE, **{f.name: getattr(SCHEDULE, f.name)[second] for f in dataclasses.fields(SCHEDULE)}
    )
    agree(both.force[second], simulate(late, alone, Sensors()).force, ROUNDING)
    # Able to fail: within an isobar the force is late.
    prompt = simulate(Bench(jnp.asarray(0.214), jnp.asarray(1.2), ()), SCHEDULE, Sensors())
    assert np.nanmax(np.abs(both.force - prompt.force)[second]) > 1.0


def test_leaving_the_calibrated_range_is_told_with_its_amount():
    calibrated = {"pressure": (1.5e5, 2e5), "length": (0.17, 0.2)}
    n = SCHEDULE.time.size
    low, high, short = describe_extrapolation(calibrated, SCHEDULE)
    assert low == f"pressure goes 50 kPa below the calibrated 150 kPa ({n // 2} of {n} samples)"
    assert high == f"pressure goes 100 kPa above the calibrated 200 kPa ({n // 2} of {n} samples)"
    assert short.startswith("length goes 10 mm below the calibrated 170 mm (")


def test_staying_inside_is_not_told():
    assert describe_extrapolation({"pressure": (1e5, 3e5), "length": (0.16, 0.2)}, SCHEDULE) == []
    # Nor is a rounding.
    assert describe_extrapolation({"pressure": (1.00001e5, 3e5), "length": (0.16, 0.2)}, SCHEDULE) == []


def test_renumbered_rows_begin_below_the_header(exact):
    taken = exact.select(np.arange(exact.n) > 10)
    assert renumber_rows(taken).row[0] == 2
