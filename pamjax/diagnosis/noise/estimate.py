"""Noise model of a recording, estimated from differences of neighbouring samples, and its whitening filter.

A misfit is smooth and noise is not, so differences of neighbouring samples estimate the noise without a
model of the misfit. Residual and derivatives are whitened by the same filter (generalised least squares).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np

from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.noise.input_noise import propagate_input_noise
from pamjax.diagnosis.settings import DiagnosisSettings
from pamjax.infer.noise.ar1_filter import Ar1Noise, compute_correlation_error
from pamjax.infer.noise.sensor_noise import compute_sensitivities
from pamjax.infer.noise.static_table import estimate_table_variance
from pamjax.infer.noise.unknown_sensor import (
    DIFFERENCE_LAGS,
    DifferenceStatistics,
    UnknownSensorNoise,
    compute_second_differences,
    estimate_stated_noise,
    estimate_unknown_noise,
)
from pamjax.infer.problem.dataset import CHANNELS, estimate_starting_sd


@dataclass(frozen=True, eq=False)
class NoiseModel:
    """Noise of force and diameter, which whitens (…, 2, n) residuals or derivatives, SI, to unit variance.

    Attributes:
        channels: noise by channel; None for a channel without measurements.
        rows: by channel, the rows in use, in order.
        runs: by channel, (k, 2) begin and end of the continuous runs in `rows`.
        weight: factor on all whitened values; below one for a model with systematic misfit.
    """

    channels: tuple[Ar1Noise | None, ...]
    rows: tuple[np.ndarray, ...]
    runs: tuple[np.ndarray, ...]
    weight: float = 1.0

    @property
    def size(self) -> int:
        """Number of samples in use."""
        return sum(r.size for r in self.rows)

    @property
    def log_determinant(self) -> float:
        """Logarithm of the determinant of the noise covariance, SI."""
        out = -2 * self.size * math.log(self.weight)
        for channel, rows, runs in zip(self.channels, self.rows, self.runs, strict=True):
            if channel is not None:
                out += 2 * float(np.sum(np.log(channel.sd[rows])))
                out += 2 * sum(channel.sum_log_sd(int(last - first)) for first, last in runs)
        return out

    def restrict_to_rows(self, mask: np.ndarray) -> NoiseModel:
        """Return the same noise model for the rows of a mask, (n,), only."""
        rows = tuple(channel_rows[mask[channel_rows]] for channel_rows in self.rows)
        runs = tuple(
            _split_runs(mask[channel_rows], run)
            for channel_rows, run in zip(self.rows, self.runs, strict=True)
        )
        return replace(self, rows=rows, runs=runs)

    def whiten(self, values: np.ndarray) -> np.ndarray:
        """Return values divided by their sd and whitened, (…, size): force first, then diameter."""
        parts = [
            self._whiten_channel(values[..., c, :], c) for c in range(len(CHANNELS)) if self.rows[c].size
        ]
        return self.weight * np.concatenate(parts, axis=-1)

    def _whiten_channel(self, values: np.ndarray, c: int) -> np.ndarray:
        channel, rows = self.channels[c], self.rows[c]
        assert channel is not None
        standard = values[..., rows] / channel.sd[rows]
        if channel.correlation == 0:
            return standard
        # The filter restarts at each run.
        parts = [channel.whiten(standard[..., first:last]) for first, last in self.runs[c]]
        return np.concatenate(parts, axis=-1)

    def standardise(self, values: np.ndarray, c: int) -> np.ndarray:
        """Return one channel over its standard deviation, (…, n), not whitened; NaN in rows not in use."""
        out = np.full(values.shape[:-2] + values.shape[-1:], np.nan)
        channel, rows = self.channels[c], self.rows[c]
        if channel is not None:
            out[..., rows] = values[..., c, rows] / channel.sd[rows]
        return out


def _split_runs(kept: np.ndarray, runs: np.ndarray) -> np.ndarray:
    """Return (k, 2) begin and end of the runs among the kept samples; a removed sample ends a run."""
    run = np.repeat(np.arange(len(runs)), runs[:, 1] - runs[:, 0])[kept]
    breaks = (np.diff(run) != 0) | (np.diff(np.flatnonzero(kept)) > 1)
    bounds = np.concatenate([[0], np.flatnonzero(breaks) + 1, [run.size]]).astype(int)
    return np.stack([bounds[:-1], bounds[1:]], axis=1) if run.size else np.zeros((0, 2), int)


def estimate_noise(
    problem: LibraryProblem, values: np.ndarray, training_rows: np.ndarray, free_scale: bool = False
) -> NoiseModel:
    """Estimate the noise model from the residual at some parameter values.

    Args:
        problem: the recording and the library.
        values: (p,) parameter values, SI.
        training_rows: (n,) mask of the rows in use.
        free_scale: whether the stated noise of a sensor may be inexact.
    """
    residual = problem.measured - problem.predict(values)
    sensor_variance, input_variance = _compute_variances(problem, values)
    # A removed row ends a run: the samples before and after it are not neighbours.
    starts = np.cumsum(problem.case.recording.starts | (np.diff(training_rows, prepend=training_rows[:1])))
    sensors = problem.case.entry.sensors
    input_noise_unknown = sensors.pressure is None or (
        sensors.length is None and not sensors.length_per_setting
    )
    channels, rows, runs = [], [], []
    tables = _estimate_table_variances(problem, training_rows)
    input_noise = propagate_input_noise(problem, values)
    for c, stated in enumerate((sensors.force, sensors.diameter)):
        channel_rows = np.flatnonzero(np.isfinite(problem.measured[c]) & training_rows)
        edges = np.flatnonzero(np.diff(starts[channel_rows])) + 1
        bounds = np.concatenate([[0], edges, [channel_rows.size]]).astype(int)
        rows.append(channel_rows)
        runs.append(
            np.stack([bounds[:-1], bounds[1:]], axis=1) if channel_rows.size else np.zeros((0, 2), int)
        )
        channels.append(
            _build_channel_noise(
                residual[c],
                sensor_variance[c],
                input_variance[c],
                channel_rows,
                starts,
                stated is not None,
                tables[c],
                None if input_noise is None else input_noise[:, c],
                input_noise_unknown,
                settings=problem.settings,
                free_scale=free_scale,
            )
            if channel_rows.size
            else None
        )
    return NoiseModel(tuple(channels), tuple(rows), tuple(runs))


def _compute_variances(problem: LibraryProblem, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the variance of sensor noise, (2, 1), and of propagated pressure and length noise, (2, n)."""
    sensors = problem.case.entry.sensors
    by_pressure, by_length = (
        np.asarray(s)[:, : problem.n] for s in compute_sensitivities(problem.dataset, jnp.asarray(values))
    )
    length = 0.0 if sensors.length_per_setting else sensors.length or 0.0
    input_variance = ((sensors.pressure or 0.0) * by_pressure) ** 2 + (length * by_length) ** 2
    return np.square(np.array(estimate_starting_sd(problem.case)))[:, None], np.nan_to_num(input_variance)


def _estimate_table_variances(
    problem: LibraryProblem, training_rows: np.ndarray
) -> list[tuple[float, float]]:
    """Return by channel the noise variance of a static table and its degrees of freedom; NaN with time.

    It uses the misfit of the neutral muscle: a model fitted to few rows would underestimate the noise.
    """
    recording = problem.case.recording
    if recording.has_time:
        return [(math.nan, 0.0)] * len(CHANNELS)
    misfit = problem.measured - problem.predict(problem.neutral)
    rows_by_channel = [np.isfinite(misfit[c]) & training_rows for c in range(len(CHANNELS))]
    return [
        estimate_table_variance(recording.pressure[rows], recording.length[rows], misfit[c, rows])
        for c, rows in enumerate(rows_by_channel)
    ]


def _build_channel_noise(
    residual,
    sensor_variance,
    input_variance,
    channel_rows,
    starts,
    stated: bool,
    table=(math.nan, 0.0),
    input_noise=None,
    input_noise_unknown=False,
    *,
    settings: DiagnosisSettings,
    free_scale: bool = False,
):
    variance, degrees_of_freedom = table
    if not stated and degrees_of_freedom > 0:
        sd = np.sqrt(np.maximum(variance, input_variance))
        return Ar1Noise(sd, 1.0, 0.0, stated, degrees_of_freedom)
    unknown_sensor = (
        None
        if stated
        else _estimate_unknown_sensor(
            residual, input_variance, input_noise, channel_rows, starts, input_noise_unknown, settings
        )
    )
    if stated and free_scale:
        statistics = _collect_difference_statistics(
            residual, input_variance, input_noise, channel_rows, starts, input_noise_unknown, settings
        )
        if statistics is not None:
            return _build_scaled_noise(statistics, sensor_variance, input_variance, channel_rows)
    if unknown_sensor:
        (correlation, sensor_variance), input_variance = (
            unknown_sensor.correlation_and_variance,
            input_variance + unknown_sensor.white_variance,
        )
    elif not stated:
        unit_sd = np.ones_like(residual)
        half_mean_square = _compute_half_mean_square(residual, unit_sd, channel_rows, starts, settings)
        sensor_variance = max(
            half_mean_square
            - _compute_input_half_mean_square(input_variance, input_noise, unit_sd, channel_rows, starts),
            1e-18,
        )
    variance = np.broadcast_to(sensor_variance + input_variance, residual.shape)
    sd = np.sqrt(variance)
    sensor_fraction = float(
        np.mean(np.broadcast_to(sensor_variance, residual.shape)[channel_rows] / variance[channel_rows])
    )
    if unknown_sensor:
        return Ar1Noise(
            sd,
            sensor_fraction,
            correlation,
            stated,
            rho_from_differences=correlation,
            unknown_sensor=unknown_sensor,
        )
    if not stated or channel_rows.size < settings.min_samples_for_correlation:
        return Ar1Noise(sd, sensor_fraction, 0.0, stated)
    # Half the mean square of neighbours' differences is W + A (1 − ρ), where W is the variance of white noise
    # and A that of AR(1) noise (`infer/noise/ar1_filter.py`). A model with a lag averages the input noise, so
    # W is smaller.
    half_mean_square, input_half_mean_square = (
        _compute_half_mean_square(residual, sd, channel_rows, starts, settings),
        _compute_input_half_mean_square(input_variance, input_noise, sd, channel_rows, starts),
    )
    if input_half_mean_square > half_mean_square:
        # The model predicts more input noise than the data show: ignore its memory.
        input_half_mean_square = _compute_input_half_mean_square(
            input_variance, None, sd, channel_rows, starts
        )
    half_mean_square -= input_half_mean_square
    rho = 1 - half_mean_square / sensor_fraction
    is_correlated = rho > settings.min_correlation_se * compute_correlation_error(
        sensor_fraction, 0.0, channel_rows.size
    )
    return Ar1Noise(
        sd,
        sensor_fraction,
        min(rho, settings.max_noise_correlation) if is_correlated else 0.0,
        stated,
        rho_from_differences=rho,
    )


def _estimate_unknown_sensor(
    residual,
    input_variance,
    input_noise,
    channel_rows,
    starts,
    input_noise_unknown: bool,
    settings: DiagnosisSettings,
) -> UnknownSensorNoise | None:
    """Estimate the noise of a sensor without stated noise; None if runs are too short."""
    statistics = _collect_difference_statistics(
        residual, input_variance, input_noise, channel_rows, starts, input_noise_unknown, settings
    )
    return None if statistics is None else estimate_unknown_noise(statistics)


def _build_scaled_noise(statistics, sensor_variance, input_variance, channel_rows) -> Ar1Noise:
    """Return the noise of a sensor whose stated noise may be inexact."""
    stated_variance = float(np.mean(np.broadcast_to(sensor_variance, input_variance.shape)[channel_rows]))
    noise = estimate_stated_noise(statistics, stated_variance)
    variance = noise.variance + noise.input_factor * input_variance
    sensor_fraction = float(np.mean(noise.variance / variance[channel_rows]))
    return Ar1Noise(
        np.sqrt(variance), sensor_fraction, noise.correlation, True, rho_from_differences=noise.correlation
    )


def _collect_difference_statistics(
    residual,
    input_variance,
    input_noise,
    channel_rows,
    starts,
    input_noise_unknown: bool,
    settings: DiagnosisSettings,
) -> DifferenceStatistics | None:
    """Return mean squares of second differences; None if runs are too short."""
    differences = [
        d[np.isfinite(d)] for d in compute_second_differences(residual[channel_rows], starts[channel_rows])
    ]
    counts = np.array([d.size for d in differences])
    if counts.min() < settings.min_samples_for_correlation:
        return None
    if input_noise is None:
        input_mean_squares = np.full(DIFFERENCE_LAGS.size, 6 * float(np.mean(input_variance[channel_rows])))
    else:
        input_mean_squares = np.array(
            [
                np.mean(d**2)
                for d in compute_second_differences(input_noise[:, channel_rows], starts[channel_rows])
            ]
        )
    return DifferenceStatistics(
        np.array([_compute_robust_mean_square(d, settings) for d in differences]),
        counts,
        input_mean_squares,
        settings.sensor_variance_sd_share,
        input_noise_unknown,
    )


def _compute_input_half_mean_square(input_variance, input_noise, sd, channel_rows, starts) -> float:
    """Return half the mean square of neighbours' differences due to input noise, over sd²."""
    if input_noise is None:
        return float(np.mean((input_variance / sd**2)[channel_rows]))
    step = np.diff((input_noise / sd)[:, channel_rows], axis=1)[:, np.diff(starts[channel_rows]) == 0]
    return 0.5 * float(np.mean(step**2)) if step.size else 0.0


def _compute_half_mean_square(residual, sd, channel_rows, starts, settings: DiagnosisSettings) -> float:
    """Return half the mean square of neighbours' differences over sd², robust against a few jumps."""
    standard = residual[channel_rows] / sd[channel_rows]
    step = np.diff(standard)[np.diff(starts[channel_rows]) == 0]
    if step.size < 3:
        return float(np.var(standard)) if standard.size > 1 else 1.0
    return 0.5 * _compute_robust_mean_square(step, settings)


def _compute_robust_mean_square(steps: np.ndarray, settings: DiagnosisSettings) -> float:
    """Return the mean square of steps, robust against a few jumps."""
    is_near = np.abs(steps) < 3.5 * 1.4826 * np.median(np.abs(steps))
    # If many steps are large (a coarse converter), they are not outliers.
    if np.mean(is_near) < settings.min_near_step_share:
        return float(np.mean(steps**2))
    # Of a normal variable 0.046 % lies beyond 3.5 standard deviations, with 0.6 % of its square.
    return float(np.mean(steps[is_near] ** 2)) * 1.0061
