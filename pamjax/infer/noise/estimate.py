"""Estimate of a recording's noise model from differences of neighbouring samples.

A misfit is smooth and noise is not, so differences of neighbouring samples estimate the noise without a
model of the misfit. `fit` and `diagnose` use this estimate.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np

from pamjax.infer.noise.ar1_filter import Ar1Noise, compute_correlation_error
from pamjax.infer.noise.inexact_sensor import estimate_inexact_noise
from pamjax.infer.noise.noise_model import NoiseModel
from pamjax.infer.noise.noise_settings import NOISE_SETTINGS, NoiseThresholds
from pamjax.infer.noise.second_differences import (
    DIFFERENCE_LAGS,
    DifferenceStatistics,
    compute_second_differences,
)
from pamjax.infer.noise.sensor_noise import compute_isotonic_variance, compute_propagated_variance
from pamjax.infer.noise.spectral_lines import remove_spectral_lines
from pamjax.infer.noise.static_table import TableVariance
from pamjax.infer.noise.unknown_sensor import estimate_unknown_noise
from pamjax.infer.problem.dataset import CHANNELS, Dataset, predict_row_channels
from pamjax.infer.problem.informative_samples import estimate_starting_sd, get_stated_sds
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
    sensors, n = case.muscle_toml.sensors, case.recording.n
    sensor_variance = np.square(np.array(estimate_starting_sd(case)))[:, None]
    if case.recording.measures_length:
        predict = predict or (lambda d: predict_row_channels(d, jnp.asarray(values)))
        return sensor_variance, compute_isotonic_variance(dataset, sensors, predict)[:, :n]
    input_variance = compute_propagated_variance(dataset, jnp.asarray(values), sensors)[:, :n]
    return sensor_variance, np.nan_to_num(input_variance)


def estimate_noise_model(
    case: Case,
    residual: np.ndarray,
    measured: np.ndarray,
    training_mask: np.ndarray,
    variances: tuple[np.ndarray, np.ndarray],
    *,
    tables: Sequence[TableVariance | None] = (None,) * len(CHANNELS),
    input_noise: np.ndarray | None = None,
    settings: NoiseThresholds = NOISE_SETTINGS,
    max_noise_ratio: float = 1.0,
) -> NoiseModel:
    """Return the noise model of a recording from the residual of a model.

    Args:
        case: the recording and its muscle.toml.
        residual: (2, n) measured − model of force and diameter, SI.
        measured: (2, n) whether a sample is measured.
        training_mask: (n,) whether a row is used in the fit.
        variances: of sensor and propagated noise, see `compute_noise_variances`.
        tables: by channel the variance of a static table, or None.
        input_noise: (draws, 2, n) change of the model by input noise, if it has memory, SI.
        settings: thresholds.
        max_noise_ratio: largest plausible ratio of true and stated noise of a sensor; 1 if it is exact.
    """
    sensor_variance, input_variance = variances
    run_number = number_runs(case.recording.is_run_start, training_mask)
    sensors = case.muscle_toml.sensors
    is_input_noise_unknown = sensors.pressure is None or (
        sensors.length is None and not sensors.length_per_level and not case.recording.measures_length
    )
    channels, rows, runs = [], [], []
    time = case.recording.time
    for c, stated in enumerate(get_stated_sds(case)):
        channel_rows = np.flatnonzero(measured[c] & training_mask)
        rows.append(channel_rows)
        runs.append(find_runs(run_number, channel_rows))
        if not channel_rows.size:
            channels.append(None)
            continue
        samples = _ChannelSamples(
            residual[c] if time is None else remove_spectral_lines(residual[c], channel_rows, time),
            channel_rows,
            run_number,
            input_variance[c],
            None if input_noise is None else input_noise[:, c],
            is_input_noise_unknown,
        )
        channels.append(
            _build_channel_noise(
                samples,
                None if stated is None else sensor_variance[c],
                tables[c],
                settings=settings,
                max_noise_ratio=max_noise_ratio,
            )
        )
    return NoiseModel(tuple(channels), tuple(rows), tuple(runs))


def number_runs(is_run_start: np.ndarray, training_mask: np.ndarray) -> np.ndarray:
    """Return the number of the continuous run of each row, (n,).

    A removed row ends a run: the samples before and after it are not neighbours.
    """
    return np.cumsum(is_run_start | np.diff(training_mask, prepend=training_mask[:1]))


def find_runs(run_number: np.ndarray, rows: np.ndarray) -> np.ndarray:
    """Return begin and end of the continuous runs in some rows, (k, 2) positions in `rows`."""
    if not rows.size:
        return np.zeros((0, 2), int)
    edges = np.flatnonzero(np.diff(run_number[rows])) + 1
    bounds = np.concatenate([[0], edges, [rows.size]]).astype(int)
    return np.stack([bounds[:-1], bounds[1:]], axis=1)


@dataclass(frozen=True, eq=False)
class _ChannelSamples:
    """Residual of one channel with the noise that pressure and length propagate to it.

    Attributes:
        residual: (n,) measured − model, SI.
        rows: rows of the samples in use, in order.
        run_number: (n,) number of the continuous run of each row.
        input_variance: (n,) variance of the propagated noise, SI squared.
        input_noise: (draws, n) change of the model by input noise, if it has memory, SI.
        is_input_noise_unknown: whether the noise of pressure or of length is not stated.
    """

    residual: np.ndarray
    rows: np.ndarray
    run_number: np.ndarray
    input_variance: np.ndarray
    input_noise: np.ndarray | None = None
    is_input_noise_unknown: bool = False


def _build_channel_noise(
    samples: _ChannelSamples,
    sensor_variance: np.ndarray | None,
    table: TableVariance | None = None,
    *,
    settings: NoiseThresholds,
    max_noise_ratio: float = 1.0,
) -> Ar1Noise:
    """Return the noise of one channel.

    Args:
        samples: residual of the channel.
        sensor_variance: (1,) stated variance of the sensor, SI squared; None if it is not stated.
        table: variance of a static table, for a sensor without stated noise.
        settings: thresholds.
        max_noise_ratio: largest plausible ratio of true and stated noise; 1 if the stated noise is exact.
    """
    if sensor_variance is None:
        if table is not None:
            return _build_table_noise(samples, table)
        return _build_unknown_sensor_noise(samples, settings)
    if max_noise_ratio > 1:
        scaled_noise = _build_scaled_noise(samples, sensor_variance, max_noise_ratio, settings)
        if scaled_noise is not None:
            return scaled_noise
    return _build_stated_noise(samples, sensor_variance, settings)


def _build_table_noise(samples: _ChannelSamples, table: TableVariance) -> Ar1Noise:
    """Return the noise of a sensor without stated noise, from the variance of a static table."""
    sd = np.sqrt(np.maximum(table.variance, samples.input_variance))
    return Ar1Noise(sd, 1.0, 0.0, False, table.degrees_of_freedom)


def _build_unknown_sensor_noise(samples: _ChannelSamples, settings: NoiseThresholds) -> Ar1Noise:
    """Return the noise of a sensor without stated noise; it is white if the runs are short."""
    statistics = _collect_difference_statistics(samples, settings)
    if statistics is None:
        unit_sd = np.ones_like(samples.residual)
        sensor_variance = max(
            _compute_half_mean_square(samples.residual, unit_sd, samples.rows, samples.run_number, settings)
            - _compute_input_half_mean_square(samples, samples.input_noise, unit_sd),
            1e-18,
        )
        return Ar1Noise(*_add_input_variance(samples, sensor_variance, samples.input_variance), 0.0, False)
    unknown_sensor = estimate_unknown_noise(statistics)
    posterior = unknown_sensor.posterior
    other_variance = samples.input_variance + unknown_sensor.white_variance
    return Ar1Noise(
        *_add_input_variance(samples, posterior.variance, other_variance),
        posterior.correlation,
        False,
        rho_from_differences=posterior.correlation,
        sensor_posterior=posterior,
    )


def _build_scaled_noise(
    samples: _ChannelSamples, sensor_variance: np.ndarray, max_noise_ratio: float, settings: NoiseThresholds
) -> Ar1Noise | None:
    """Return the noise of a sensor whose stated noise may be inexact.

    The result is None if the runs are short or the ratio of true and stated noise is not plausible.
    """
    statistics = _collect_difference_statistics(samples, settings)
    if statistics is None:
        return None
    rows, input_variance = samples.rows, samples.input_variance
    stated_variance = float(np.mean(np.broadcast_to(sensor_variance, input_variance.shape)[rows]))
    noise = estimate_inexact_noise(statistics, stated_variance)
    posterior = noise.posterior
    ratios = np.sqrt([posterior.variance / stated_variance, noise.input_factor])
    if ratios.max() > max_noise_ratio or ratios[0] < 1 / max_noise_ratio:
        # Misfit that changes from sample to sample, and no sensor noise.
        return None
    return Ar1Noise(
        *_add_input_variance(samples, posterior.variance, noise.input_factor * input_variance),
        posterior.correlation,
        True,
        rho_from_differences=posterior.correlation,
        sensor_posterior=posterior,
    )


def _build_stated_noise(
    samples: _ChannelSamples, sensor_variance: np.ndarray, settings: NoiseThresholds
) -> Ar1Noise:
    """Return the noise of a sensor with its stated variance; the samples give its correlation."""
    sd, sensor_fraction = _add_input_variance(samples, sensor_variance, samples.input_variance)
    if samples.rows.size < settings.min_samples_for_correlation:
        return Ar1Noise(sd, sensor_fraction, 0.0, True)
    # Half the mean square of neighbours' differences is W + A (1 − ρ), where W is the variance of white noise
    # and A that of AR(1) noise (`infer/noise/ar1_filter.py`). A model with a lag averages the input noise, so
    # W is smaller.
    half_mean_square = _compute_half_mean_square(
        samples.residual, sd, samples.rows, samples.run_number, settings
    )
    input_half_mean_square = _compute_input_half_mean_square(samples, samples.input_noise, sd)
    if input_half_mean_square > half_mean_square:
        # The model predicts more input noise than the data show: ignore its memory.
        input_half_mean_square = _compute_input_half_mean_square(samples, None, sd)
    rho = 1 - (half_mean_square - input_half_mean_square) / sensor_fraction
    is_correlated = rho > settings.min_correlation_se * compute_correlation_error(
        sensor_fraction, 0.0, samples.rows.size
    )
    return Ar1Noise(
        sd,
        sensor_fraction,
        min(rho, settings.max_noise_correlation) if is_correlated else 0.0,
        True,
        rho_from_differences=rho,
    )


def _add_input_variance(
    samples: _ChannelSamples, sensor_variance: np.ndarray | float, input_variance: np.ndarray
) -> tuple[np.ndarray, float]:
    """Return the sd of the total noise, (n,) SI, and the mean fraction of the sensor's variance."""
    shape, rows = samples.residual.shape, samples.rows
    variance = np.broadcast_to(sensor_variance + input_variance, shape)
    fraction = np.mean(np.broadcast_to(sensor_variance, shape)[rows] / variance[rows])
    return np.sqrt(variance), float(fraction)


def _collect_difference_statistics(
    samples: _ChannelSamples, settings: NoiseThresholds
) -> DifferenceStatistics | None:
    """Return mean squares of second differences; None if runs are too short."""
    rows, run_number = samples.rows, samples.run_number[samples.rows]
    differences = [d[np.isfinite(d)] for d in compute_second_differences(samples.residual[rows], run_number)]
    counts = np.array([d.size for d in differences])
    if counts.min() < settings.min_samples_for_correlation:
        return None
    if samples.input_noise is None:
        input_mean_squares = np.full(DIFFERENCE_LAGS.size, 6 * float(np.mean(samples.input_variance[rows])))
    else:
        input_differences = compute_second_differences(samples.input_noise[:, rows], run_number)
        input_mean_squares = np.array([np.mean(d**2) for d in input_differences])
    return DifferenceStatistics(
        np.array([_compute_robust_mean_square(d, settings) for d in differences]),
        counts,
        input_mean_squares,
        settings.sensor_variance_sd_share,
        samples.is_input_noise_unknown,
    )


def _compute_input_half_mean_square(
    samples: _ChannelSamples, input_noise: np.ndarray | None, sd: np.ndarray
) -> float:
    """Return half the mean square of neighbours' differences due to input noise, over sd²."""
    if input_noise is None:
        return float(np.mean((samples.input_variance / sd**2)[samples.rows]))
    is_neighbour = np.diff(samples.run_number[samples.rows]) == 0
    step = np.diff((input_noise / sd)[:, samples.rows], axis=1)[:, is_neighbour]
    return 0.5 * float(np.mean(step**2)) if step.size else 0.0


def _compute_half_mean_square(
    residual: np.ndarray,
    sd: np.ndarray,
    rows: np.ndarray,
    run_number: np.ndarray,
    settings: NoiseThresholds,
) -> float:
    """Return half the mean square of neighbours' differences over sd², robust against a few jumps."""
    standard = residual[rows] / sd[rows]
    step = np.diff(standard)[np.diff(run_number[rows]) == 0]
    if step.size < 3:
        return float(np.var(standard)) if standard.size > 1 else 1.0
    return 0.5 * _compute_robust_mean_square(step, settings)


def estimate_neighbour_sd(residual: np.ndarray, rows: np.ndarray, is_run_start: np.ndarray) -> float:
    """Return the sd of independent noise with the observed differences of neighbouring samples, SI.

    Args:
        residual: (n,) measured − model, SI.
        rows: rows of the samples, in the order of time.
        is_run_start: (n,) whether a run begins at this row.
    """
    unit_sd, run_number = np.ones_like(residual), np.cumsum(is_run_start)
    return math.sqrt(_compute_half_mean_square(residual, unit_sd, rows, run_number, NOISE_SETTINGS))


def _compute_robust_mean_square(steps: np.ndarray, settings: NoiseThresholds) -> float:
    """Return the mean square of steps, robust against a few jumps."""
    is_near = np.abs(steps) < 3.5 * 1.4826 * np.median(np.abs(steps))
    # If many steps are large (a coarse converter), they are not outliers.
    if np.mean(is_near) < settings.min_near_step_share:
        return float(np.mean(steps**2))
    # Of a normal variable 0.046 % lies beyond 3.5 standard deviations, with 0.6 % of its square.
    return float(np.mean(steps[is_near] ** 2)) * 1.0061
