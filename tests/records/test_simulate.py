"""A simulated recording is the output of the muscle with the stated noise."""

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
from pamjax.records.simulate import describe_extrapolation, draw_ar1_noise, simulate
from tests.agreement import ROUNDING, agree

MUSCLE = Muscle(0.2, 0.214, 1.2, LinearThread(5e5))
PLAN = Protocol(kind="strokes", pressures=["1 bar", "3 bar"], contractions=[0.2], speed="0.1 mm/s")
SCHEDULE = PLAN.build_schedule(0.2)
SENSORS = Sensors(force=2.0, diameter=5e-5, pressure=700.0, length=2e-5)


@pytest.fixture(scope="module")
def exact():
    return simulate(MUSCLE, SCHEDULE, Sensors())


def test_recording_without_noise_is_the_output_of_the_muscle(exact):
    reading = predict(MUSCLE, SCHEDULE.pressure, SCHEDULE.length)
    agree(exact.force, reading.force, ROUNDING)
    agree(exact.diameter, reading.diameter, ROUNDING)
    np.testing.assert_array_equal(exact.length, SCHEDULE.length)


def test_each_channel_has_its_own_noise(exact):
    noisy = simulate(MUSCLE, SCHEDULE, SENSORS, seed=1)
    n = noisy.n
    for channel in ("force", "diameter", "pressure", "length"):
        error = getattr(noisy, channel) - getattr(exact, channel)
        sd = getattr(SENSORS, channel)
        assert np.std(error) == pytest.approx(sd, rel=5 / np.sqrt(2 * n))
        assert abs(np.mean(error)) < 5 * sd / np.sqrt(n)


def test_noise_depends_only_on_the_seed():
    first, again, other = (simulate(MUSCLE, SCHEDULE, SENSORS, seed=s) for s in (1, 1, 2))
    np.testing.assert_array_equal(first.force, again.force)
    assert np.all(first.force != other.force)


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.95])
def test_correlated_noise_has_its_variance_and_correlation(correlation):
    noise = draw_ar1_noise(np.random.default_rng(0), 200_000, correlation)
    autocorrelation_time = (1 + correlation) / (1 - correlation)
    assert np.var(noise) == pytest.approx(1.0, abs=5 * np.sqrt(2 * autocorrelation_time / 200_000))
    assert np.mean(noise[1:] * noise[:-1]) == pytest.approx(
        correlation, abs=5 * np.sqrt(2 * autocorrelation_time / 200_000)
    )


def test_a_correlation_time_is_in_seconds(exact):
    noisy = simulate(MUSCLE, SCHEDULE, Sensors(force=2.0), correlation_time=5.0)
    error = noisy.force - exact.force
    lag_one = np.mean(error[1:] * error[:-1]) / np.mean(error**2)
    assert lag_one == pytest.approx(np.exp(-1 / 5), abs=0.06)


def test_ruler_error_is_constant_for_each_setting():
    plan = Protocol(kind="ramps", pressures=["3 bar"], contractions=[0.0, 0.1, 0.2])
    sensors = Sensors(length=1e-3, length_per_level=True)
    schedule = plan.build_schedule(0.2)
    recording = simulate(MUSCLE, schedule, sensors, seed=3)
    errors = (recording.length - schedule.length).reshape(3, -1)
    agree(np.ptp(errors, axis=1), 0.0, 1e-15, scale=1.0)
    assert np.unique(errors[:, 0]).size == 3
    # The force is the force at the true length.
    agree(recording.force, predict(MUSCLE, schedule.pressure, schedule.length).force, ROUNDING)


def test_states_without_equilibrium_are_blank():
    deep = Protocol(kind="strokes", pressures=["3 bar"], contractions=[0.5]).build_schedule(0.2)
    force = simulate(MUSCLE, deep, SENSORS).force
    would_push = np.asarray(predict(MUSCLE, deep.pressure, deep.length).force) < 0
    np.testing.assert_array_equal(np.isnan(force), would_push)
    long = Protocol(kind="strokes", pressures=["3 bar"], contractions=[-0.1]).build_schedule(0.2)
    assert np.isnan(simulate(MUSCLE, long, SENSORS).diameter).any()


def test_diameter_is_recorded_at_its_own_interval():
    plan = dataclasses.replace(SCHEDULE, diameter_measured=np.arange(SCHEDULE.time.size) % 5 == 0)
    is_measured = np.isfinite(simulate(MUSCLE, plan, SENSORS).diameter)
    np.testing.assert_array_equal(is_measured, plan.diameter_measured)


def test_bench_without_mechanisms_agrees_with_the_muscle():
    rigid = Muscle(0.2, 0.214, 1.2)
    bench = Bench(jnp.asarray(0.214), jnp.asarray(1.2), ())
    of_muscle, of_bench = (simulate(m, SCHEDULE, SENSORS, seed=4) for m in (rigid, bench))
    agree(of_muscle.force, of_bench.force, 1e-9, scale=1.0)


def test_lag_does_not_cross_the_step_between_isobars():
    delayed = Bench(jnp.asarray(0.214), jnp.asarray(1.2), (ChannelLag(lag=jnp.asarray(1.7)),))
    both_isobars, second = simulate(delayed, SCHEDULE, Sensors()), SCHEDULE.pressure > 2e5
    second_schedule = dataclasses.replace(
        SCHEDULE,
        **{
            f.name: getattr(SCHEDULE, f.name)[second]
            for f in dataclasses.fields(SCHEDULE)
            if getattr(SCHEDULE, f.name) is not None
        },
    )
    agree(both_isobars.force[second], simulate(delayed, second_schedule, Sensors()).force, ROUNDING)
    # Negative control: within an isobar the force is delayed.
    undelayed = simulate(Bench(jnp.asarray(0.214), jnp.asarray(1.2), ()), SCHEDULE, Sensors())
    assert np.nanmax(np.abs(both_isobars.force - undelayed.force)[second]) > 1.0


def test_extrapolation_is_reported_with_its_amount():
    calibrated_range = {"pressure": (1.5e5, 2e5), "length": (0.17, 0.2)}
    n = SCHEDULE.time.size
    low, high, short = describe_extrapolation(calibrated_range, SCHEDULE)
    assert (
        low == f"pressure is up to 50 kPa below the calibrated minimum of 150 kPa ({n // 2} of {n} samples)"
    )
    assert (
        high == f"pressure is up to 100 kPa above the calibrated maximum of 200 kPa ({n // 2} of {n} samples)"
    )
    assert short.startswith("length is up to 10 mm below the calibrated minimum of 170 mm (")


def test_calibrated_range_is_not_reported():
    assert describe_extrapolation({"pressure": (1e5, 3e5), "length": (0.16, 0.2)}, SCHEDULE) == []
    # A rounding error is not reported either.
    assert describe_extrapolation({"pressure": (1.00001e5, 3e5), "length": (0.16, 0.2)}, SCHEDULE) == []
