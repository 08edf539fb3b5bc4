"""Noise of means of neighbouring samples, from the noise of the samples.

White noise of variance W and AR(1) noise of variance A and correlation ρ give the mean of m samples

    variance    W / m + A R(m),    R(m) = (1 + 2 Σ_k (1 − k/m) ρ^k) / m,    0 < k < m,

and the correlated part of neighbouring means

    covariance  A ρ ((1 − ρ^m) / (m (1 − ρ)))².

The noise of means is that with this variance and this correlation of neighbours: AR(1) and white noise.
Neglects: at larger distances the covariance decreases by ρ^m from group to group, faster than that of this
AR(1) noise, so that slow noise is overestimated by up to a fifth.
Source: sums of the autocovariance of AR(1) noise, derived here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pamjax.infer.noise.ar1_filter import Ar1Noise
from pamjax.infer.noise.estimate import find_runs
from pamjax.infer.noise.noise_model import NoiseModel
from pamjax.infer.noise.sensor_posterior import SensorPosterior
from pamjax.records.row_averages import RowAverages, find_typical_count

#: Smallest correlation of neighbouring samples: estimates by chance can be below −1.
_MIN_CORRELATION = -0.9


def average_noise(
    noise: NoiseModel,
    averages: RowAverages,
    channels: Sequence[str],
    in_use: np.ndarray,
    run_number: np.ndarray,
) -> NoiseModel:
    """Return the noise of means.

    Args:
        noise: noise of the samples.
        averages: the groups of samples.
        channels: names of the channels of the noise.
        in_use: (2, k) whether the mean of each group is used.
        run_number: (k,) number of the continuous run of each group.
    """
    counts = [averages.count(name) for name in channels]
    rows = tuple(np.flatnonzero(mask) for mask in in_use)
    force, diameter = (float(count[count > 0].mean()) if count.any() else 1.0 for count in counts)
    return replace(
        noise,
        by_channel=tuple(
            None if channel is None or not channel_rows.size else _average_channel(channel, averages, count)
            for channel, count, channel_rows in zip(noise.by_channel, counts, rows, strict=True)
        ),
        rows=rows,
        runs=tuple(find_runs(run_number, channel_rows) for channel_rows in rows),
        samples_per_row=(force, diameter),
    )


def _average_channel(channel: Ar1Noise, averages: RowAverages, counts: np.ndarray) -> Ar1Noise:
    typical, rho = round(find_typical_count(counts)), channel.correlation
    measured_rho = max(channel.rho_from_differences, _MIN_CORRELATION)
    correlated = channel.ar1_fraction * compute_mean_variance(counts, rho)
    white = (1 - channel.ar1_fraction) / np.maximum(counts, 1)
    typical_correlated = channel.ar1_fraction * float(compute_mean_variance(typical, rho))
    typical_white = (1 - channel.ar1_fraction) / typical
    sample_variance = averages.sum(channel.sd**2) / averages.sum(np.ones(channel.sd.size))
    posterior = channel.sensor_posterior
    return replace(
        channel,
        sd=np.sqrt(sample_variance * (correlated + white)),
        ar1_fraction=typical_correlated / (typical_correlated + typical_white),
        correlation=float(compute_mean_correlation(typical, rho)),
        rho_from_differences=float(compute_mean_correlation(typical, measured_rho)),
        sensor_posterior=None if posterior is None else _average_posterior(posterior, typical),
    )


def _average_posterior(posterior: SensorPosterior, count: float) -> SensorPosterior:
    rho, variance = posterior.support.T
    support = [compute_mean_correlation(count, rho), variance * compute_mean_variance(count, rho)]
    return SensorPosterior(
        float(compute_mean_correlation(count, posterior.correlation)),
        posterior.variance * float(compute_mean_variance(count, posterior.correlation)),
        np.stack(support, axis=1),
        posterior.probability,
    )


def compute_mean_variance(count: np.ndarray | float, correlation: np.ndarray | float) -> np.ndarray:
    """Return R, the variance of the mean of some samples of unit variance; 1 for less than two samples."""
    m, rho = np.broadcast_arrays(np.maximum(np.asarray(count, dtype=float), 1.0), correlation)
    # The closed form of the sum.
    slow = (1 + rho) / (1 - rho) - 2 * rho * (1 - rho**m) / (m * (1 - rho) ** 2)
    return slow / m


def compute_mean_correlation(count: np.ndarray | float, correlation: np.ndarray | float) -> np.ndarray:
    """Return the correlation of the means of neighbouring groups, of AR(1) noise."""
    m, rho = np.broadcast_arrays(np.asarray(count, dtype=float), correlation)
    return rho * ((1 - rho**m) / (m * (1 - rho))) ** 2 / compute_mean_variance(m, rho)
