"""Simulated testbed: muscle, rig and noise of a recording, on which new protocols are simulated."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path

import jax.numpy as jnp
import numpy as np

from pamjax.diagnosis.crossval.solved_lengths import predict_solved
from pamjax.diagnosis.library.library_problem import LibraryProblem, compute_program_rows
from pamjax.diagnosis.next_experiment.power import LinearisedModel
from pamjax.diagnosis.next_experiment.protocols import PlannedProtocol
from pamjax.diagnosis.next_experiment.rig import CAMERA_SD_M, RigLimits, compute_usual_load
from pamjax.diagnosis.noise.estimate import predict_dataset
from pamjax.diagnosis.refit.least_squares import (
    UNIFORM_RANGE_SD,
    UNINFORMATIVE_PRIOR_SD,
    transform_to_coordinates,
)
from pamjax.diagnosis.refit.model_fit import ModelFit
from pamjax.infer.noise.ar1_filter import Ar1Noise
from pamjax.infer.noise.noise_model import NoiseModel
from pamjax.infer.noise.sensor_noise import compute_effective_sd, compute_isotonic_variance
from pamjax.infer.problem.dataset import build_history, build_rows
from pamjax.infer.problem.informative_samples import find_informative_samples, get_stated_sds
from pamjax.records.case import Case
from pamjax.records.protocol import Schedule
from pamjax.records.recording import Recording

#: Range of the length at a set force, in rest lengths.
_SOLVED_LENGTH_RANGE = 0.4, 1.3

#: Usual speed of a pressure ramp if the recording has no time, Pa/s.
_USUAL_PRESSURE_SPEED = 5e3

#: Seconds between a recording and the next protocol.
_PAUSE_BEFORE_PROTOCOL_S = 60.0


@dataclass(frozen=True, eq=False)
class SimulatedTestbed:
    """Muscle, rig and noise of a recording, for the simulation of protocols.

    Attributes:
        problem: the recording and the library.
        rig: limits of the rig.
        sensor_sd: sensor noise of one sample of force (N), or of length (m) on an isotonic rig, and of
            diameter (m), 1 sd.
        sd_inflation: factor on the noise for a model with systematic misfit; 1 without.
        correlations: by channel, correlation of neighbouring samples and the time between them, s.
        start_time: start of a new protocol, s.
    """

    problem: LibraryProblem
    rig: RigLimits
    sensor_sd: tuple[float, float]
    sd_inflation: float
    correlations: tuple[tuple[float, float], ...]
    start_time: float

    @classmethod
    def from_fit(cls, problem: LibraryProblem, fit: ModelFit) -> SimulatedTestbed:
        """Return the testbed of a recording and its fitted model."""
        recording = problem.case.recording
        step, end_time, duration = _read_clock(recording)
        channels = fit.noise.by_channel
        observed_sd = [
            CAMERA_SD_M if channel is None else fit.noise.compute_rms_sd(c)
            for c, channel in enumerate(channels)
        ]
        force_stated_sd, diameter_stated_sd = get_stated_sds(problem.case)
        sensor_sd = (force_stated_sd or observed_sd[0], diameter_stated_sd or observed_sd[1])
        sd_inflation = np.sqrt(max(fit.estimate.chi2 / max(fit.noise.size, 1), 1.0))
        correlations = tuple((0.0 if c is None else c.correlation, step) for c in channels)
        return cls(
            problem,
            _estimate_rig_limits(recording, problem.case, sensor_sd, step, duration),
            sensor_sd,
            float(sd_inflation),
            correlations,
            end_time + _PAUSE_BEFORE_PROTOCOL_S,
        )

    def simulate_at(self, schedule: Schedule, values: np.ndarray) -> LibraryProblem:
        """Return the problem on a new schedule; the lengths at set forces are those at values (p,), SI."""
        if schedule.load is None:
            return self.simulate(schedule)
        rest_length, recording = self.rig.rest_length, self.problem.case.recording
        order = np.argsort(recording.pressure[recording.usable])
        pressure, length = (x[recording.usable][order] for x in (recording.pressure, recording.length))
        start = dataclasses.replace(schedule, length=np.interp(schedule.pressure, pressure, length))
        solved = predict_solved(self.simulate(start), values)[0]
        low, high = (share * rest_length for share in _SOLVED_LENGTH_RANGE)
        return self.simulate(dataclasses.replace(schedule, length=np.clip(np.nan_to_num(solved), low, high)))

    def simulate(self, schedule: Schedule) -> LibraryProblem:
        """Return the problem on a new schedule; it uses the same compiled program unless it is longer."""
        problem, n = self.problem, schedule.time.size
        size = max(problem.dataset.rows.pressure.size, compute_program_rows(n))
        recording = Recording.from_arrays(
            time=schedule.time, pressure=schedule.pressure, length=schedule.length, cycle=schedule.cycle,
            force=np.full(n, 1e3) if schedule.load is None else schedule.load,
            diameter=np.where(schedule.diameter_measured, 1.0, np.nan),
            measures_length=schedule.load is not None,
        )  # fmt: skip
        case = Case(
            problem.case.name,
            Path(),
            problem.case.muscle_toml,
            recording,
            "",
            (),
            "carry",
            problem.case.before,
        )
        rows = build_rows(case, size)
        rows = dataclasses.replace(rows, length_level=jnp.zeros_like(rows.length_level))
        history = build_history(case, size, compute_padding=False)
        return dataclasses.replace(
            problem,
            case=case,
            dataset=dataclasses.replace(problem.dataset, rows=rows, history=history),
            measured=np.full((2, n), np.nan),
            samples=None,
        )

    def build_noise(self, problem: LibraryProblem, values: np.ndarray, is_measured: np.ndarray) -> NoiseModel:
        """Return the noise model of a protocol for the samples in `is_measured`, (2, n)."""
        sd = self._compute_effective_sd(problem, values)[:, : problem.n]
        sd = self.sd_inflation * np.nan_to_num(sd, nan=1e30)
        step, _, _ = _read_clock(problem.case.recording)
        channels, rows, runs = [], [], []
        for c in range(2):
            channel_rows = np.flatnonzero(is_measured[c])
            rows.append(channel_rows)
            runs.append(np.array([[0, channel_rows.size]]) if channel_rows.size else np.zeros((0, 2), int))
            rho, per = self.correlations[c]
            ar1_fraction = (
                float(np.mean((self.sd_inflation * self.sensor_sd[c] / sd[c][channel_rows]) ** 2))
                if channel_rows.size
                else 1.0
            )
            channels.append(
                Ar1Noise(sd[c], ar1_fraction, rho ** (step / per), True) if channel_rows.size else None
            )
        return NoiseModel(tuple(channels), tuple(rows), tuple(runs))

    def _compute_effective_sd(self, problem: LibraryProblem, values: np.ndarray) -> np.ndarray:
        """Return the noise of every sample with the propagated noise of the inputs, SI, (2, rows)."""
        sensors = problem.case.muscle_toml.sensors
        if self.rig.load is None:
            return compute_effective_sd(problem.dataset, jnp.asarray(values), sensors, self.sensor_sd)
        variance = compute_isotonic_variance(
            problem.dataset, sensors, lambda dataset: predict_dataset(problem, dataset, values)
        )
        return np.sqrt(np.square(self.sensor_sd)[:, None] + variance)


def _read_clock(recording: Recording) -> tuple[float, float, float]:
    """Return the time between samples, the time of the last sample, and the duration, s."""
    if recording.time is None or recording.n < 2:
        return 1.0, 0.0, 0.0
    step = max(float(np.median(np.diff(recording.time))), 1e-3)
    return step, float(recording.time[-1]), float(np.ptp(recording.time))


def _estimate_rig_limits(
    recording: Recording, case: Case, sensor_sd, step: float, duration: float
) -> RigLimits:
    usable = recording.usable
    rest_length, sensors = case.muscle_toml.rest_length.value, case.muscle_toml.sensors
    length = recording.length[usable]
    speed = np.abs(np.diff(length)) / step
    moving = speed[speed > 0.2 * np.max(speed, initial=0.0)]
    strokes = moving.size > 0.2 * speed.size
    ramp_speed = np.abs(np.diff(recording.pressure[usable])) / step
    is_isotonic = recording.measures_length
    return RigLimits(
        rest_length=rest_length,
        max_pressure=float(np.max(recording.pressure[usable])),
        max_contraction=float(max(1 - np.min(length) / rest_length, 0.05)),
        speed=float(np.median(moving)) if strokes else 1e-3,
        step=step,
        force_noise=(sensors.force or 0.0) if is_isotonic else sensor_sd[0],
        diameter_noise=sensor_sd[1],
        pressure_noise=sensors.pressure or 1e-3 * float(np.max(recording.pressure[usable])),
        length_noise=sensor_sd[0] if is_isotonic else sensors.length or 2e-5,
        max_force=_find_max_force(recording, case),
        has_camera=bool(np.isfinite(recording.diameter).any()),
        duration=duration,
        load=float(np.nanmedian(recording.force)) if is_isotonic else None,
        pressure_speed=float(np.median(ramp_speed[ramp_speed > 0.2 * np.max(ramp_speed, initial=0.0)]))
        if is_isotonic and ramp_speed.any()
        else _USUAL_PRESSURE_SPEED,
    )


def _find_max_force(recording: Recording, case: Case) -> float:
    """Return the largest force, N; on an isotonic rig at least a share of the ideal force at rest."""
    largest = float(np.nanmax(recording.force, initial=0.0 if recording.measures_length else 10.0))
    if not recording.measures_length:
        return largest
    return max(largest, compute_usual_load(case.muscle_toml, float(np.nanmax(recording.pressure))))


def linearise_difference(
    testbed: SimulatedTestbed, protocol: PlannedProtocol, a: ModelFit, b: ModelFit
) -> tuple[np.ndarray, LinearisedModel, LinearisedModel]:
    """Return the whitened difference of two models on a protocol, (m,), and both linearised models."""
    problem = testbed.problem
    delta, jacobians = [], [[], []]
    schedule = protocol.build_schedule(testbed.rig, testbed.start_time)
    if schedule is not None:
        planned_problem = testbed.simulate_at(schedule, a.estimate.values)
        (shown_a, jacobian_a), (shown_b, jacobian_b) = (
            planned_problem.predict_with_jacobian(m.estimate.values, m.estimate.free) for m in (a, b)
        )
        is_measured = np.isfinite(shown_a) & np.isfinite(shown_b)
        if testbed.rig.load is None:
            # A negative force means that the muscle is slack: such samples do not distinguish the models.
            is_measured &= (shown_a[0] > 0) & (shown_b[0] > 0)
        else:
            # Without pressure, the length at a set force is arbitrary.
            is_measured &= find_informative_samples(planned_problem.case, "length")
        is_measured[1] &= schedule.diameter_measured
        noise = testbed.build_noise(planned_problem, a.estimate.values, is_measured)
        if noise.size:
            delta.append(noise.whiten(np.nan_to_num(shown_a - shown_b)))
            for k, (fit, jacobian) in enumerate(((a, jacobian_a), (b, jacobian_b))):
                jacobians[k].append(noise.whiten(np.nan_to_num(jacobian)) * fit.estimate.scale[:, None])
    for k, sd in get_direct_readings(testbed, protocol, a, b).items():
        delta.append(np.array([(a.estimate.values[k] - b.estimate.values[k]) / sd]))
        for j, fit in enumerate((a, b)):
            is_read = np.array([float(index == k) for index in fit.estimate.free])
            jacobians[j].append((is_read * fit.estimate.scale / sd)[:, None])
    if not delta:
        delta, jacobians = [np.zeros(0)], [[np.zeros((len(m.estimate.free), 0))] for m in (a, b)]
    first, second = (
        LinearisedModel(np.concatenate(jacobian, axis=1), _compute_information(problem, m))
        for m, jacobian in zip((a, b), jacobians, strict=True)
    )
    return np.concatenate(delta), first, second


def get_direct_readings(
    testbed: SimulatedTestbed, protocol: PlannedProtocol, a: ModelFit, b: ModelFit
) -> dict[int, float]:
    """Return the standard deviations of directly measured parameters by index, SI."""
    problem, out = testbed.problem, {}
    for name, sd in protocol.get_direct_readings(testbed.rig).items():
        if name in problem.names:
            k = problem.index(name)
            magnitude = max(abs(a.estimate.values[k]), abs(b.estimate.values[k]), 1e-12)
            out[k] = sd if sd >= 0 else -sd * magnitude
    return out


def _compute_information(problem: LibraryProblem, fit: ModelFit) -> np.ndarray:
    """Return the information on a model's parameters from recording, priors and limits, in coordinates."""
    jacobian, free = fit.estimate.jacobian, fit.estimate.free
    low, high = (transform_to_coordinates(problem, free, edge) for edge in (problem.low, problem.high))
    # The variance of a uniform distribution is a twelfth of the squared distance of its limits.
    prior_sd = np.where(
        fit.estimate.prior_sd < UNINFORMATIVE_PRIOR_SD, fit.estimate.prior_sd, (high - low) / UNIFORM_RANGE_SD
    )
    return jacobian.T @ jacobian + np.diag(1 / prior_sd**2)
