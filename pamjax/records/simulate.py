"""Simulated recordings of a muscle on a bench, with sensor noise."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from pamjax.errors import BadInput
from pamjax.model.balance import Status
from pamjax.model.bench import Bench, record_bench
from pamjax.model.history import History, build_time_history
from pamjax.model.isotonic import solve_lengths
from pamjax.model.muscle import Muscle, predict
from pamjax.records.protocol import Schedule
from pamjax.records.reading.muscle_toml import MuscleToml, Sensors
from pamjax.records.recording import Recording


def simulate(
    muscle: Muscle | Bench,
    schedule: Schedule,
    sensors: Sensors,
    *,
    seed: int = 0,
    correlation_time: float = 0.0,
    settled: bool = False,
    deviation: np.ndarray | None = None,
) -> Recording:
    """Return a simulated recording of a schedule.

    Force is NaN where the muscle has no equilibrium or would push. Diameter is NaN where the muscle has no
    equilibrium. If the schedule sets the force, the length is simulated, and the noise of `sensors.force` is
    that of the set force. Length and diameter are NaN where the muscle has no equilibrium length.

    Args:
        muscle: the true muscle, or a `Bench`: a muscle with mechanisms.
        schedule: pressure and length at every sample.
        sensors: noise of each channel; a channel without noise is exact.
        seed: seed of the noise.
        correlation_time: correlation time of the noise of force and diameter, s.
        settled: whether the muscle has run the schedule once before.
        deviation: (2, n) difference of force (N) and diameter (m) from the equations of the muscle, such as
            form errors; None for exact equations. A schedule that sets the force has none.

    Returns:
        a recording with the rows of the schedule.

    Example:
        from pamjax.records.protocol import PAPER_PROTOCOL

        loaded = pamjax.load_muscle("mine")
        schedule = PAPER_PROTOCOL.build_schedule(rest_length=0.2)  # m
        recording = pamjax.simulate(loaded.muscle, schedule, loaded.muscle_toml.sensors, seed=1)
        print(recording.to_frame())
    """
    if schedule.load is not None:
        return _simulate_isotonic(muscle, schedule, sensors, seed, settled)
    rng = np.random.default_rng(seed)
    n = schedule.time.size
    reading = _predict_readings(muscle, schedule, settled)
    force_deviation, diameter_deviation = np.zeros((2, n)) if deviation is None else deviation
    has_equilibrium = np.asarray(reading.status) == Status.OK
    step = float(schedule.time[1] - schedule.time[0]) if n > 1 else 1.0
    correlation = float(np.exp(-step / correlation_time)) if correlation_time > 0 else 0.0
    force = np.where(has_equilibrium, np.asarray(reading.force) + force_deviation, np.nan)
    diameter = np.where(
        has_equilibrium & schedule.diameter_measured,
        np.asarray(reading.diameter) + diameter_deviation,
        np.nan,
    )
    return Recording.from_arrays(
        time=schedule.time,
        pressure=schedule.pressure + (sensors.pressure or 0.0) * rng.standard_normal(n),
        length=schedule.length + _draw_length_error(schedule, sensors, rng),
        force=np.where(force >= 0, force, np.nan)
        + (sensors.force or 0.0) * draw_ar1_noise(rng, n, correlation),
        diameter=diameter + (sensors.diameter or 0.0) * draw_ar1_noise(rng, n, correlation),
        cycle=schedule.cycle,
    )


def _simulate_isotonic(
    muscle: Muscle | Bench, schedule: Schedule, sensors: Sensors, seed: int, settled: bool
) -> Recording:
    """Return a simulated recording of the length at a set force."""
    assert schedule.load is not None
    rng, n = np.random.default_rng(seed), schedule.time.size
    true_load = schedule.load + (sensors.force or 0.0) * rng.standard_normal(n)
    reading, is_solved = solve_lengths(
        muscle,
        jnp.asarray(schedule.pressure),
        jnp.asarray(schedule.length),
        jnp.asarray(true_load),
        build_schedule_history(schedule, settled),
    )
    length, diameter = (
        np.where(is_solved, np.asarray(values), np.nan) for values in (reading.length, reading.diameter)
    )
    diameter = np.where(schedule.diameter_measured, diameter, np.nan)
    return Recording.from_arrays(
        time=schedule.time,
        pressure=schedule.pressure + (sensors.pressure or 0.0) * rng.standard_normal(n),
        length=length + (sensors.length or 0.0) * rng.standard_normal(n),
        force=schedule.load,
        diameter=diameter + (sensors.diameter or 0.0) * rng.standard_normal(n),
        cycle=schedule.cycle,
        measures_length=True,
    )


def _predict_readings(muscle: Muscle | Bench, schedule: Schedule, settled: bool):
    pressure, length = jnp.asarray(schedule.pressure), jnp.asarray(schedule.length)
    if isinstance(muscle, Muscle):
        return predict(muscle, pressure, length)
    return record_bench(muscle, pressure, length, build_schedule_history(schedule, settled))


def build_schedule_history(schedule: Schedule, settled: bool) -> History:
    """Return the order of the samples of a schedule."""
    # The continuous parts are those of the written recording. No delay acts across the step between two.
    exact_recording = Recording.from_arrays(
        time=schedule.time, pressure=schedule.pressure, length=schedule.length, cycle=schedule.cycle
    )
    return build_time_history(
        schedule.time,
        exact_recording.is_run_start,
        settled=settled,
        stroke_channels=exact_recording.length_and_pressure,
    )


def _draw_length_error(schedule: Schedule, sensors: Sensors, rng: np.random.Generator) -> np.ndarray:
    n = schedule.length.size
    if not sensors.length_per_level:
        return (sensors.length or 0.0) * rng.standard_normal(n)
    # The ruler is read once per length level: all samples of a level have the same error.
    _, level_index = np.unique(schedule.length.round(6), return_inverse=True)
    return (sensors.length or 0.0) * rng.standard_normal(level_index.max() + 1)[level_index]


def draw_ar1_noise(rng: np.random.Generator, n: int, correlation: float) -> np.ndarray:
    """Return first-order autoregressive noise of unit variance, (n,)."""
    from scipy.signal import lfilter

    white = rng.standard_normal(n)
    if correlation == 0 or n == 0:
        return white
    white[1:] *= np.sqrt(1 - correlation**2)
    return np.asarray(lfilter([1.0], [1.0, -correlation], white))


def check_set_channel(schedule: Schedule, muscle_toml: MuscleToml) -> None:
    """Refuse a schedule that sets the channel which muscle.toml declares as measured.

    Raises:
        BadInput: if one sets the force and the other the length, or if their loads differ.
    """
    if muscle_toml.measures_length and schedule.load is None:
        rule = "a muscle with a measured length needs a protocol that sets the force"
        remedy = 'Write a protocol with kind = "ramps" and loads = ["0 N"], or remove [test] of muscle.toml.'
        raise BadInput.from_rule(rule, "a protocol that sets the length", remedy=remedy)
    if schedule.load is not None and not muscle_toml.measures_length:
        remedy = 'Write measured = "length" in the table [test].'
        raise BadInput.from_rule(
            "`loads` need a muscle.toml with a measured length", "a measured force", remedy=remedy
        )
    if (
        schedule.load is not None
        and muscle_toml.load is not None
        and (schedule.load != muscle_toml.load).any()
    ):
        rule = f"`loads` must equal `load` in [test] of muscle.toml ({muscle_toml.load:g} N)"
        raise BadInput.from_rule(
            rule, f"up to {schedule.load.max():g} N", remedy="Remove `load` from [test]."
        )


def describe_extrapolation(calibrated_range: dict[str, tuple[float, float]], schedule: Schedule) -> list[str]:
    """Return sentences about pressures (Pa) and lengths (m) of a schedule outside the calibrated range.

    Args:
        calibrated_range: lowest and highest calibrated value of "pressure", "length" or both, SI.
        schedule: pressure and length at every sample.

    Returns:
        one sentence for each exceeded limit; empty if the schedule is inside the range.
    """
    sentences = []
    for name, unit, scale in (("pressure", "kPa", 1e3), ("length", "mm", 1e-3)):
        if name not in calibrated_range or (name == "length" and schedule.load is not None):
            continue
        low, high = calibrated_range[name]
        values = getattr(schedule, name)
        for excess, limit, is_outside, side in (
            (low - values.min(), low, values < low, "below the calibrated minimum"),
            (values.max() - high, high, values > high, "above the calibrated maximum"),
        ):
            if excess > 1e-3 * max(high - low, 1e-12) and excess > 1e-9:
                sentences.append(
                    f"{name} is up to {excess / scale:.3g} {unit} {side} of {limit / scale:.4g} {unit} "
                    f"({int(is_outside.sum())} of {values.size} samples)"
                )
    return sentences
