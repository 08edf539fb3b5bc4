"""Uncertainty of the noise variance along a direction, due to the estimated noise of the sensor.

A direction d, white and of unit length, has the noise variance

    V(ρ′, v) = Σ_ω |d(ω)|² S(ω; ρ′, v) / S(ω; ρ, 1),    S(ω; ρ, v) = 1 − A + v A (1 − ρ²) / |1 − ρ e^(−iω)|²,

if the true correlation is ρ′ and the assumed one is ρ, and the true variance of the sensor is v times the
assumed one; v is 1 for an exact statement. A larger ρ′ gives a slow direction more variance and a
fast one less. The prior of ρ′ is one half at zero and one half uniform up to the setting
`max_noise_correlation`. The likelihood is the estimate from neighbours' differences with its standard error.
This error is large if the sensor noise is a small part of the total. The input noise is known only to a share
of its variance. A channel without an estimated correlation has the uncertainty of a variance from that many
squared differences. If the noise of a sensor is not stated, or the statement may be inexact, the recording
also determines its variance. Variance and correlation are then uncertain together (`sensor_posterior.py`).
Neglects: the ends of runs, and the posterior correlation of sensor noise and propagated noise.
Source: filtering of a stationary process, derived here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm, truncnorm

from pamjax.diagnosis.settings import DiagnosisSettings
from pamjax.infer.noise.ar1_filter import Ar1Noise, compute_correlation_error
from pamjax.infer.noise.noise_model import NoiseModel
from pamjax.infer.noise.sensor_posterior import SensorPosterior

#: Standard normal variables at which the noise variance is computed; between them it is interpolated.
NORMAL_NODES = np.linspace(-4.0, 4.0, 33)


@dataclass(frozen=True, eq=False)
class NoiseUncertainty:
    """Noise variance along directions, relative to the assumed one, as a function of normal variables.

    Attributes:
        known_variance: (k,) the part without uncertainty, from the priors.
        variance_by_channel: (k, channels, nodes) the part of each channel at `NORMAL_NODES`.
    """

    known_variance: np.ndarray
    variance_by_channel: np.ndarray

    def compute_sd(self, normal: np.ndarray) -> np.ndarray:
        """Return (m, k) standard deviations for (m, channels) standard normal variables."""
        variance = np.broadcast_to(self.known_variance, (len(normal), self.known_variance.size)).copy()
        position = np.interp(normal, NORMAL_NODES, np.arange(NORMAL_NODES.size))
        below = np.minimum(position.astype(int), NORMAL_NODES.size - 2)
        over = position - below
        for c in range(normal.shape[1]):
            by = self.variance_by_channel[:, c]
            variance += (by[:, below[:, c]] * (1 - over[:, c]) + by[:, below[:, c] + 1] * over[:, c]).T
        return np.sqrt(variance)


def estimate_noise_uncertainty(
    noise: NoiseModel, directions: np.ndarray, settings: DiagnosisSettings
) -> NoiseUncertainty:
    """Return the uncertainty of the noise variance of each direction.

    Args:
        noise: the noise model.
        directions: (k, size or more) whitened directions; entries after the samples belong to the priors.
        settings: thresholds of the diagnosis.
    """
    parts, begin = [], 0
    for channel, rows in zip(noise.by_channel, noise.rows, strict=True):
        part = directions[:, begin : begin + rows.size]
        begin += rows.size
        parts.append(_compute_channel_variances(channel, part, settings))
    by_channel = np.stack(parts, axis=1)
    return NoiseUncertainty(np.sum(directions[:, begin:] ** 2, axis=1), by_channel)


def _compute_channel_variances(
    channel: Ar1Noise | None, direction_part: np.ndarray, settings: DiagnosisSettings
) -> np.ndarray:
    """Return the variances of one channel at the nodes, (k, nodes)."""
    samples, share = direction_part.shape[1], np.sum(direction_part**2, axis=1)[:, None]
    # Noise estimated with few degrees of freedom is already covered by Student's t distribution.
    if channel is None or samples < 2 or math.isfinite(channel.degrees_of_freedom):
        return np.repeat(share, NORMAL_NODES.size, axis=1)
    variance_factors = np.exp(NORMAL_NODES * math.sqrt(3 / samples))
    if samples < settings.min_samples_for_correlation or not (channel.is_stated or channel.sensor_posterior):
        return share * variance_factors
    power = np.abs(np.fft.fft(direction_part, axis=1)) ** 2 / samples
    phase = np.exp(-2j * np.pi * np.arange(samples) / samples)
    assumed_density = _compute_spectral_density(channel.ar1_fraction, channel.correlation, 1.0, phase)
    if channel.sensor_posterior:
        rho, times = _get_posterior_nodes(channel.sensor_posterior)
        density_ratios = [
            _compute_spectral_density(channel.ar1_fraction, *rho_and_factor, phase) / assumed_density
            for rho_and_factor in zip(rho, times, strict=True)
        ]
        variances = power @ np.stack(density_ratios, axis=1)
        # The posterior of a stated sensor contains the error of a variance from that many differences.
        return variances if channel.is_stated else variances * variance_factors
    density_ratios = [
        _compute_spectral_density(channel.ar1_fraction, rho, 1.0, phase) / assumed_density
        for rho in _compute_correlation_nodes(channel, samples, settings)
    ]
    return power @ np.stack(density_ratios, axis=1)


def _get_posterior_nodes(posterior: SensorPosterior) -> tuple[np.ndarray, np.ndarray]:
    """Return correlation and variance over the assumed one, at the nodes, (nodes,) each."""
    k = np.minimum(
        np.searchsorted(np.cumsum(posterior.probability), norm.cdf(NORMAL_NODES)),
        posterior.probability.size - 1,
    )
    rho, variance = posterior.support[k].T
    return rho, variance / posterior.variance


def _compute_correlation_nodes(channel: Ar1Noise, samples: int, settings: DiagnosisSettings) -> np.ndarray:
    """Return the posterior quantiles of the correlation at the nodes, (nodes,)."""
    estimated_rho = channel.rho_from_differences
    by_chance = compute_correlation_error(
        channel.ar1_fraction, min(max(estimated_rho, 0.0), settings.max_noise_correlation), samples
    )
    # The variance of input noise is known only to a share; its error shifts the estimate of ρ.
    error = math.hypot(
        by_chance, settings.sensor_variance_sd_share * (1 - channel.ar1_fraction) / channel.ar1_fraction
    )
    low, high = -estimated_rho / error, (settings.max_noise_correlation - estimated_rho) / error
    continuous_weight = float(norm.cdf(high) - norm.cdf(low)) / settings.max_noise_correlation
    zero_weight = float(norm.pdf(estimated_rho / error)) / error
    zero_weight = (
        zero_weight / (zero_weight + continuous_weight)
        if zero_weight + continuous_weight > 0
        else float(estimated_rho < 0)
    )
    rank = np.clip((norm.cdf(NORMAL_NODES) - zero_weight) / max(1 - zero_weight, 1e-12), 0.0, 1.0)
    correlation = truncnorm.ppf(rank, low, high, estimated_rho, error)
    return np.where(rank > 0, np.clip(correlation, 0.0, settings.max_noise_correlation), 0.0)


def _compute_spectral_density(
    ar1_fraction: float, correlation: float, variance_factor: float, phase: np.ndarray
) -> np.ndarray:
    """Return the noise spectrum at e^(−iω) for unit variance, with a factor on the correlated part."""
    return (
        1
        - ar1_fraction
        + variance_factor * ar1_fraction * (1 - correlation**2) / np.abs(1 - correlation * phase) ** 2
    )
