"""Noise of a sensor whose stated noise may be inexact, from the statement and the recording.

The stated noise is exact with probability `_EXACT_PROBABILITY`. Otherwise the true variances of the sensor
and of the propagated noise differ from the stated ones by `_INEXACT_VARIANCE_ERROR`. The data are the mean
squares of second differences (`second_differences.py`). Both hypotheses contribute to the posterior; the
estimate is that of the more probable one.
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

#: Prior probability that a stated noise is exact, and the relative error of its variance if it is or is not.
_EXACT_PROBABILITY, _EXACT_VARIANCE_ERROR, _INEXACT_VARIANCE_ERROR = 0.7, 0.05, 0.5
#: Smallest estimated over stated variance.
_MIN_VARIANCE_FACTOR = 0.05
#: Smallest mean square over its stated value.
_MIN_SQUARE_SHARE = 1e-4
#: Fits of the variance factors with the scatter that they predict.
_SCATTER_ROUNDS = 3


@dataclass(frozen=True, eq=False)
class InexactSensorNoise:
    """Noise of a sensor whose stated noise may be inexact.

    Attributes:
        posterior: correlation and variance of the sensor.
        input_factor: estimated over stated variance of the propagated noise of pressure and length.
    """

    posterior: SensorPosterior
    input_factor: float


def estimate_inexact_noise(statistics: DifferenceStatistics, stated_variance: float) -> InexactSensorNoise:
    """Return the noise of a sensor from its stated noise and mean squares of second differences.

    Args:
        statistics: mean squares of the residual and of the propagated noise.
        stated_variance: of the sensor, SI squared.
    """
    from scipy.special import logsumexp

    # A recording almost free of noise: the floor is far below the smallest estimate of a variance.
    floor = np.maximum(_MIN_SQUARE_SHARE * (statistics.propagated_variance + 6 * stated_variance), 1e-36)
    statistics = replace(statistics, mean_squares=np.maximum(statistics.mean_squares, floor))
    hypotheses = [
        _fit_factors(statistics, stated_variance, error)
        for error in (_EXACT_VARIANCE_ERROR, _INEXACT_VARIANCE_ERROR)
    ]
    log_likelihood = np.stack([hypothesis.log_likelihood for hypothesis in hypotheses])
    log_prior = np.log([[_EXACT_PROBABILITY], [1 - _EXACT_PROBABILITY]]) + np.log(CORRELATION_PRIOR)
    probability = np.exp(log_prior + log_likelihood - np.asarray(logsumexp(log_prior + log_likelihood)))
    best = int(np.argmax(probability.sum(axis=1)))
    rho = estimate_correlation(probability[best] / probability[best].sum())
    sensor, propagated = (
        max(float(np.interp(rho, CORRELATION_GRID, factor)), _MIN_VARIANCE_FACTOR)
        for factor in (hypotheses[best].sensor_factor, hypotheses[best].input_factor)
    )
    posterior = build_sensor_posterior(
        rho,
        sensor * stated_variance,
        probability,
        stated_variance * np.stack([h.sensor_factor for h in hypotheses]),
        stated_variance * np.stack([h.sensor_factor_error for h in hypotheses]),
    )
    return InexactSensorNoise(posterior, propagated)


@dataclass(frozen=True, eq=False)
class _FactorFits:
    """Factors on the stated variances at each correlation of the grid, with one prior error of them.

    Attributes:
        log_likelihood: (grid,) with the factors and the curvature integrated out.
        sensor_factor: (grid,) posterior mean of the factor on the sensor's variance.
        sensor_factor_error: (grid,) its posterior standard deviation.
        input_factor: (grid,) posterior mean of the factor on the propagated variance.
    """

    log_likelihood: np.ndarray
    sensor_factor: np.ndarray
    sensor_factor_error: np.ndarray
    input_factor: np.ndarray


def _fit_factors(
    statistics: DifferenceStatistics, stated_variance: float, relative_error: float
) -> _FactorFits:
    """Return the factors from a linear Gaussian model with a prior, at all correlations at once."""
    mean, covariance = (
        np.stack(part)
        for part in zip(*map(compute_expected_squares, range(CORRELATION_GRID.size)), strict=True)
    )
    squares, per = statistics.mean_squares, 1 / np.sqrt(statistics.counts)
    columns = (
        mean * stated_variance / squares,
        statistics.propagated_variance / squares,
        statistics.compute_curvature(),
    )
    design = np.stack(np.broadcast_arrays(*columns), axis=-1)
    prior_mean, prior_sd = np.array([1.0, 1.0, 0.0]), np.array([relative_error, relative_error, 1.0])
    scaled = design * prior_sd
    targets = np.concatenate([(1 - design @ prior_mean)[..., None], scaled], axis=-1)
    factors, white, root = np.broadcast_to(prior_mean, (*mean.shape[:1], 3)), targets, covariance
    for _ in range(_SCATTER_ROUNDS):
        # The relative scatter of a mean square is that of its expected noise.
        scatter = per * np.maximum(np.sum(design[..., :2] * factors[:, None, :2], axis=-1), 0.1)
        total = covariance * scatter[:, :, None] * scatter[:, None, :] + scaled @ scaled.mT
        root = np.linalg.cholesky(total + 1e-12 * np.eye(per.size))
        white = np.linalg.solve(root, targets)
        factors = prior_mean + prior_sd * np.sum(white[..., 1:] * white[..., :1], axis=1)
    log_determinant = np.log(np.diagonal(root, axis1=1, axis2=2)).sum(axis=1)
    explained_share = np.sum(white[..., 1] ** 2, axis=1)
    return _FactorFits(
        -0.5 * np.sum(white[..., 0] ** 2, axis=1) - log_determinant,
        factors[:, 0],
        relative_error * np.sqrt(np.maximum(1 - explained_share, 1e-6)),
        factors[:, 1],
    )
