"""Noise of a sensor whose noise is not stated: variance and correlation, from the recording alone.

The mean squares of second differences determine both (`second_differences.py`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from pamjax.infer.noise.second_differences import DifferenceStatistics, compute_expected_squares
from pamjax.infer.noise.sensor_posterior import (
    CORRELATION_GRID,
    CORRELATION_PRIOR,
    SensorPosterior,
    build_sensor_posterior,
    estimate_correlation,
)


@dataclass(frozen=True, eq=False)
class UnknownSensorNoise:
    """Estimate of a sensor's noise from a recording.

    Attributes:
        posterior: correlation and variance of the sensor.
        white_variance: variance of additional white noise that is not stated, SI squared.
    """

    posterior: SensorPosterior
    white_variance: float


def estimate_unknown_noise(statistics: DifferenceStatistics) -> UnknownSensorNoise:
    """Return variance and correlation of noise from mean squares of second differences."""
    # A lower bound for recordings almost free of noise, far below the stated noise.
    floor = np.maximum(1e-6 * statistics.propagated_variance, 1e-36)
    statistics = replace(statistics, mean_squares=np.maximum(statistics.mean_squares, floor))
    log_likelihood, variance, error, white = np.array(
        [_fit_correlation(k, statistics) for k in range(CORRELATION_GRID.size)]
    ).T
    probability = CORRELATION_PRIOR * np.exp(log_likelihood - log_likelihood.max())
    probability /= probability.sum()
    rho = estimate_correlation(probability)
    sensor_variance, white_variance = (
        float(np.interp(rho, CORRELATION_GRID, values)) for values in (np.maximum(variance, 1e-36), white)
    )
    posterior = build_sensor_posterior(rho, sensor_variance, probability, variance, error)
    return UnknownSensorNoise(posterior, white_variance)


def _fit_correlation(k: int, statistics: DifferenceStatistics) -> tuple[float, float, float, float]:
    """Return the log-likelihood of one correlation, the variance, its error, and other white variance."""
    from scipy.linalg import solve_triangular
    from scipy.optimize import nnls

    mean, covariance = compute_expected_squares(k)
    squares, per = statistics.mean_squares, 1 / np.sqrt(statistics.counts)
    # All terms are relative to the measured mean squares.
    propagated, curvature = statistics.propagated_variance / squares, statistics.compute_curvature()
    root = np.linalg.cholesky(
        covariance * np.outer(per, per) + statistics.propagated_error**2 * np.outer(propagated, propagated)
    )
    columns = [mean / squares, curvature]
    if statistics.allows_white_noise and CORRELATION_GRID[k] > 0:
        columns.append(6 / squares)
    rows = solve_triangular(root, np.stack([*columns, 1 - propagated], axis=1), lower=True)
    design, target = rows[:, :-1], rows[:, -1]
    (variance, *rest), residual_norm = nnls(design, target)
    other_columns = design[:, 1:][:, np.array(rest) > 0]
    own_column = design[:, 0] - other_columns @ np.linalg.lstsq(other_columns, design[:, 0])[0]
    unconstrained_variance = own_column @ target / (own_column @ own_column)
    log_likelihood = -0.5 * residual_norm**2 - np.log(np.diag(root)).sum()
    return (
        float(log_likelihood),
        float(unconstrained_variance if variance == 0 else variance),
        float((own_column @ own_column) ** -0.5),
        sum(rest[1:]),
    )
