"""Test of the mean square of a residual against noise, for misfit without a tested pattern.

The residual r of a channel, over its assumed standard deviation, has the mean square

    E r² = 1 − A + A v,     var(mean of r²) = (E r²)² (2 (1 + 2 a² ρ² / (1 − ρ²)) / n + u²),

where A is the autocorrelated fraction of the variance, v the true over the assumed variance of the sensor,
a = A v / E r², n the number of samples and u an allowance for the relative error of any variance. Where the
recording itself determines the noise of the sensor, the p-value is the mean over the posterior of v and ρ.
The test allows for a sensor that is noisier than stated, so it rarely detects misfit.
Source: variance of a mean square of a Gaussian process, M. S. Bartlett, Suppl. J. R. Stat. Soc. 8, 27 (1946).
"""

from __future__ import annotations

import math

import numpy as np
from scipy.stats import norm

from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.least_squares import MapEstimate
from pamjax.infer.form_errors.discrepancy import DiscrepancyNoise
from pamjax.infer.noise.ar1_filter import Ar1Noise
from pamjax.infer.noise.noise_model import NoiseModel


def compute_mean_square_significance(
    problem: LibraryProblem, noise: NoiseModel, estimate: MapEstimate
) -> tuple[float, float]:
    """Return the most significant mean square of a channel's residual, and the smallest p-value.

    Only channels with stated noise have a p-value: the others have their noise from this residual alone.

    Args:
        problem: the recording and the library.
        noise: noise model of the refit.
        estimate: the refit.
    """
    residual = problem.measured - problem.predict(estimate.values)
    if isinstance(noise, DiscrepancyNoise):
        residual = residual - noise.estimate_discrepancy(residual)
    mean_square, largest_z, smallest_p = 1.0, -math.inf, 1.0
    for c, channel in enumerate(noise.by_channel):
        if channel is None or noise.rows[c].size == 0:
            continue
        standardised = noise.standardise(residual, c)[noise.rows[c]]
        mean = float(np.mean(standardised**2))
        # Slow noise decreases less in means than the noise of the sensor: the error is that of a sample.
        variance_error = problem.settings.sensor_variance_sd_share * noise.samples_per_row[c]
        assumed_noise = np.array([channel.correlation]), np.ones(1)
        z_score = float(
            _compute_z_scores(mean, channel, standardised.size, variance_error, *assumed_noise)[0]
        )
        if z_score > largest_z:
            # Means have less noise than a sample, to which the limits of a residual refer.
            mean_square, largest_z = 1 + (mean - 1) / noise.samples_per_row[c], z_score
        if channel.is_stated:
            p_value = _compute_p_value(mean, channel, standardised.size, variance_error)
            smallest_p = min(smallest_p, p_value)
    return mean_square, smallest_p


def _compute_p_value(mean: float, channel: Ar1Noise, samples: int, variance_error: float) -> float:
    """Return the probability that noise has a larger mean square."""
    posterior = channel.sensor_posterior
    if posterior is None:
        correlation, factor, weight = np.array([channel.correlation]), np.ones(1), np.ones(1)
    else:
        correlation, variance = posterior.support.T
        factor, weight = variance / posterior.variance, posterior.probability
    z_scores = _compute_z_scores(mean, channel, samples, variance_error, correlation, factor)
    return float(weight @ norm.sf(z_scores))


def _compute_z_scores(
    mean: float,
    channel: Ar1Noise,
    samples: int,
    variance_error: float,
    correlation: np.ndarray,
    factor: np.ndarray,
) -> np.ndarray:
    """Return the excess of a mean square in standard errors, (k,), for (k,) correlations and factors v."""
    sensor_part = channel.ar1_fraction * factor
    expected = 1 - channel.ar1_fraction + sensor_part
    inflation = 1 + 2 * (sensor_part / expected * correlation) ** 2 / np.maximum(1 - correlation**2, 1e-3)
    error = expected * np.sqrt(2 * inflation / samples + variance_error**2)
    return (mean - expected) / error
