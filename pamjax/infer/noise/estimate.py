"""Estimate of a recording's noise model from differences of neighbouring samples.

A misfit is smooth and noise is not, so differences of neighbouring samples estimate the noise without a
model of the misfit. `fit` and `diagnose` use this estimate.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import jax.numpy as jnp
import numpy as np

from pamjax.infer.noise.ar1_filter import Ar1Noise, compute_correlation_error
from pamjax.infer.noise.noise_model import NoiseModel
from pamjax.infer.noise.noise_settings import NOISE_SETTINGS, NoiseThresholds
from pamjax.infer.noise.sensor_noise import compute_isotonic_variance, compute_sensitivities
from pamjax.infer.noise.spectral_lines import remove_spectral_lines
from pamjax.infer.noise.unknown_sensor import (
    DIFFERENCE_LAGS,
    DifferenceStatistics,
    UnknownSensorNoise,
    compute_second_differences,
    estimate_stated_noise,
    estimate_unknown_noise,
)
from pamjax.infer.problem.dataset import (
    CHANNELS,
    Dataset,
    estimate_starting_sd,
    get_stated_sds,
    predict_row_channels,
)
from pamjax.records.case import Case


def compute_noise_variances(
    case: Case,
    dataset: Dataset,
    values: np.ndarray,
    predict: Callable[[Dataset], np.ndarray] | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the variance of sensor noise, (2, 1), and of propagated pressure and length noise, (2, n), SI.

    Args:
        case: the recording and its muscle.toml.
        dataset: its dataset.
        values: (p,) parameter values, SI.
        predict: both predicted channels of a dataset at these values, (2, n), for an isotonic recording.
    """
    sensors, n = case.entry.sensors, case.recording.n
    own_variance = np.square(np.array(estimate_starting_sd(case)))[:, None]
    if case.recording.measures_length:
        predict = predict or (lambda d: predict_row_channels(d, jnp.asarray(values)))
        return own_variance, compute_isotonic_variance(dataset, sensors, predict)[:, :n]
    by_pressure, by_length = (
        np.asarray(s)[:, :n] for s in compute_sensitivities(dataset, jnp.asarray(values))
    )
    length = 0.0 if sensors.length_per_setting else sensors.length or 0.0
    input_variance = ((sensors.pressure or 0.0) * by_pressure) ** 2 + (length * by_length) ** 2
    return own_variance, np.nan_to_num(input_variance)


def estimate_noise_model(
    case: Case,
    residual: np.ndarray,
    measured: np.ndarray,
    rows_in_use: np.ndarray,
    variances: tuple[np.ndarray, np.ndarray],
    *,
    tables: Sequence[tuple[float, float]] = ((math.nan, 0.0),) * len(CHANNELS),
    input_noise: np.ndarray | None = None,
    settings: NoiseThresholds = NOISE_SETTINGS,
    max_noise_ratio: float = 1.0,
) -> NoiseModel:
    """Return the noise model of a recording from the residual of a model.

    Args:
        case: the recording and its muscle.toml.
        residual: (2, n) measured − model of force and diameter, SI.
        measured: (2, n) whether a sample is measured.
        rows_in_use: (n,) whether a row is in use.
        variances: of sensor and propagated noise, see `compute_noise_variances`.
        tables: by channel the variance of a static table and its degrees of freedom, zero for none.
        input_noise: (draws, 2, n) change of the model by input noise, if it has memory, SI.
        settings: thresholds.
        max_noise_ratio: largest plausible ratio of true and stated noise of a sensor; 1 if it is exact.
    """
    sensor_variance, input_variance = variances
    # A removed row ends a run: the samples before and after it are not neighbours.
    starts = np.cumsum(case.recording.starts | np.diff(rows_in_use, prepend=rows_in_use[:1]))
    sensors = case.entry.sensors
    input_noise_unknown = sensors.pressure is None or (
        sensors.length is None and not sensors.length_per_setting and not case.recording.measures_length
    )
    channels, rows, runs = [], [], []
    time = case.recording.time
    for c, stated in enumerate(get_stated_sds(case)):
        channel_rows = np.flatnonzero(measured[c] & rows_in_use)
        edges = np.flatnonzero(np.diff(starts[channel_rows])) + 1
        bounds = np.concatenate([[0], edges, [channel_rows.size]]).astype(int)
        rows.append(channel_rows)
        runs.append(
            np.stack([bounds[:-1], bounds[1:]], axis=1) if channel_rows.size else np.zeros((0, 2), int)
        )
        channels.append(
            _build_channel_noise(
                residual[c] if time is None else remove_spectral_lines(residual[c], channel_rows, time),
                sensor_variance[c],
                input_variance[c],
                channel_rows,
                starts,
                stated is not None,
                tables[c],
                None if input_noise is None else input_noise[:, c],
                input_noise_unknown,
                settings=settings,
                max_noise_ratio=max_noise_ratio,
            )
            if channel_rows.size
            else None
        )
    return NoiseModel(tuple(channels), tuple(rows), tuple(runs))


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
    settings: NoiseThresholds,
    max_noise_ratio: float = 1.0,
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
    if stated and max_noise_ratio > 1:
        statistics = _collect_difference_statistics(
            residual, input_variance, input_noise, channel_rows, starts, input_noise_unknown, settings
        )
        scaled_noise = (
            None
            if statistics is None
            else _build_scaled_noise(
                statistics, sensor_variance, input_variance, channel_rows, max_noise_ratio
            )
        )
        if scaled_noise is not None:
            return scaled_noise
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
    settings: NoiseThresholds,
) -> UnknownSensorNoise | None:
    """Estimate the noise of a sensor without stated noise; None if runs are too short."""
    statistics = _collect_difference_statistics(
        residual, input_variance, input_noise, channel_rows, starts, input_noise_unknown, settings
    )
    return None if statistics is None else estimate_unknown_noise(statistics)


def _build_scaled_noise(
    statistics, sensor_variance, input_variance, channel_rows, max_noise_ratio: float
) -> Ar1Noise | None:
    """Return the noise of a sensor whose stated noise may be inexact; None if the ratio is not plausible."""
    stated_variance = float(np.mean(np.broadcast_to(sensor_variance, input_variance.shape)[channel_rows]))
    noise = estimate_stated_noise(statistics, stated_variance)
    ratios = np.sqrt([noise.variance / stated_variance, noise.input_factor])
    if ratios.max() > max_noise_ratio or ratios[0] < 1 / max_noise_ratio:
        # Misfit that changes from sample to sample, and no sensor noise.
        return None
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
    settings: NoiseThresholds,
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


def _compute_half_mean_square(residual, sd, channel_rows, starts, settings: NoiseThresholds) -> float:
    """Return half the mean square of neighbours' differences over sd², robust against a few jumps."""
    standard = residual[channel_rows] / sd[channel_rows]
    step = np.diff(standard)[np.diff(starts[channel_rows]) == 0]
    if step.size < 3:
        return float(np.var(standard)) if standard.size > 1 else 1.0
    return 0.5 * _compute_robust_mean_square(step, settings)


def estimate_neighbour_sd(residual: np.ndarray, rows: np.ndarray, starts: np.ndarray) -> float:
    """Return the sd of independent noise with the observed differences of neighbouring samples, SI.

    Args:
        residual: (n,) measured − model, SI.
        rows: rows of the samples, in the order of time.
        starts: (n,) whether a run begins at this row.
    """
    unit_sd = np.ones_like(residual)
    return math.sqrt(_compute_half_mean_square(residual, unit_sd, rows, np.cumsum(starts), NOISE_SETTINGS))


def _compute_robust_mean_square(steps: np.ndarray, settings: NoiseThresholds) -> float:
    """Return the mean square of steps, robust against a few jumps."""
    is_near = np.abs(steps) < 3.5 * 1.4826 * np.median(np.abs(steps))
    # If many steps are large (a coarse converter), they are not outliers.
    if np.mean(is_near) < settings.min_near_step_share:
        return float(np.mean(steps**2))
    # Of a normal variable 0.046 % lies beyond 3.5 standard deviations, with 0.6 % of its square.
    return float(np.mean(steps[is_near] ** 2)) * 1.0061
