"""Noise of means of neighbouring samples, from the noise of the samples.

White noise of variance W and AR(1) noise of variance A and correlation ρ give the mean of m samples

    variance    W / m + A R(m),    R(m) = (1 + 2 Σ_k (1 − k/m) ρ^k) / m,    0 < k < m,

and the correlated parts of neighbouring means of m and l samples

    covariance  A ρ g(m) g(l),     g(m) = (1 − ρ^m) / (m (1 − ρ)).

Each mean has these values: some groups have one sample, others many.
Neglects: at larger distances the covariance decreases by ρ^m from group to group, faster than that of AR(1)
noise with the correlation of neighbours. The sd of slow noise is overestimated by up to a fifth.
Noise that is slower than differences of neighbouring samples show, such as a drift, is underestimated.
Source: sums of the autocovariance of AR(1) noise, derived here.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pamjax.infer.noise.ar1_filter import Ar1Noise, SampleNoise
from pamjax.infer.noise.estimate import find_runs
from pamjax.infer.noise.noise_model import NoiseModel
from pamjax.infer.noise.sensor_posterior import CORRELATION_GRID, SensorPosterior
from pamjax.records.row_averages import RowAverages

#: Smallest and largest correlation of neighbouring samples: estimates by chance can be outside.
_CORRELATION_RANGE = -0.9, float(CORRELATION_GRID[-1])


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
    rows = tuple(np.flatnonzero(mask) for mask in in_use)
    runs = tuple(find_runs(run_number, channel_rows) for channel_rows in rows)
    counts = [averages.count(name) for name in channels]
    force, diameter = (float(count[count > 0].mean()) if count.any() else 1.0 for count in counts)
    by_channel = []
    for c, channel in enumerate(noise.by_channel):
        if channel is None or not rows[c].size:
            by_channel.append(None)
            continue
        sizes = _GroupSizes.from_counts(counts[c], rows[c], runs[c])
        by_channel.append(_average_channel(channel, noise.rows[c], averages, sizes))
    return replace(
        noise, by_channel=tuple(by_channel), rows=rows, runs=runs, samples_per_row=(force, diameter)
    )


@dataclass(frozen=True, eq=False)
class _GroupSizes:
    """Numbers of samples of the groups of a channel.

    Attributes:
        counts: (k,) samples of each group, at least 1.
        rows: groups in use.
        pairs: (j, 2) positions in all groups of each neighbouring pair in use.
    """

    counts: np.ndarray
    rows: np.ndarray
    pairs: np.ndarray

    @classmethod
    def from_counts(cls, counts: np.ndarray, rows: np.ndarray, runs: np.ndarray) -> _GroupSizes:
        """Return the sizes from all counts, the groups in use, and begin and end of their runs."""
        is_start = np.zeros(rows.size, dtype=bool)
        is_start[runs[:, 0]] = True
        later = np.flatnonzero(~is_start)
        return cls(np.maximum(counts, 1.0), rows, np.stack([rows[later - 1], rows[later]], axis=1))

    def compute_variances(self, rho: float) -> np.ndarray:
        """Return R of each group, (k,)."""
        return compute_mean_variance(self.counts, rho)

    def compute_mean_variance(self, rho: float) -> float:
        """Return the mean of R over the groups in use."""
        return float(np.mean(self.compute_variances(rho)[self.rows]))

    def compute_correlations(self, rho: float) -> np.ndarray:
        """Return the correlation of the means of each pair, (j,)."""
        before, after = (self.counts[self.pairs[:, k]] for k in (0, 1))
        return compute_mean_correlation(before, after, rho)

    def compute_mean_correlation(self, rho: float) -> float:
        """Return the mean correlation of the pairs; that of samples without a pair."""
        rho = float(np.clip(rho, *_CORRELATION_RANGE))
        return float(np.mean(self.compute_correlations(rho))) if self.pairs.size else rho


def _average_channel(
    channel: Ar1Noise, sample_rows: np.ndarray, averages: RowAverages, sizes: _GroupSizes
) -> Ar1Noise:
    """Return the noise of the means of a channel; `sample_rows` are its samples in use."""
    rho, variance = channel.correlation, channel.sd**2
    # The sensor has one variance. The noise of pressure and length propagates differently to each sample.
    sensor_variance = channel.ar1_fraction / np.mean(1 / variance[sample_rows])
    white = np.maximum(averages.sum(variance) / averages.sum(np.ones(variance.size)) - sensor_variance, 0.0)
    correlated = sensor_variance * sizes.compute_variances(rho)
    total = correlated + white / sizes.counts
    fraction, correlation = correlated / total, np.zeros(total.size)
    correlation[sizes.pairs[:, 1]] = sizes.compute_correlations(rho)
    posterior = channel.sensor_posterior
    return replace(
        channel,
        sd=np.sqrt(total),
        ar1_fraction=float(np.mean(fraction[sizes.rows])),
        correlation=sizes.compute_mean_correlation(rho),
        rho_from_differences=sizes.compute_mean_correlation(channel.rho_from_differences),
        sensor_posterior=None if posterior is None else _average_posterior(posterior, sizes),
        by_sample=SampleNoise(fraction, correlation),
    )


def _average_posterior(posterior: SensorPosterior, sizes: _GroupSizes) -> SensorPosterior:
    rho, variance = posterior.support.T
    by_rho = {
        value: (sizes.compute_mean_correlation(value), sizes.compute_mean_variance(value))
        for value in {*rho.tolist(), posterior.correlation}
    }
    means = np.array([by_rho[value] for value in rho.tolist()])
    correlation, ratio = by_rho[posterior.correlation]
    return SensorPosterior(
        correlation,
        posterior.variance * ratio,
        np.stack([means[:, 0], variance * means[:, 1]], axis=1),
        posterior.probability,
    )


def compute_mean_variance(count: np.ndarray | float, rho: float) -> np.ndarray:
    """Return R, the variance of the mean of some samples of unit variance."""
    m = np.asarray(count, dtype=float)
    # The closed form of the sum.
    return ((1 + rho) / (1 - rho) - 2 * rho * (1 - rho**m) / (m * (1 - rho) ** 2)) / m


def compute_mean_correlation(
    count: np.ndarray | float, next_count: np.ndarray | float, rho: float
) -> np.ndarray:
    """Return the correlation of neighbouring means of some samples of AR(1) noise."""
    sizes = [np.asarray(m, dtype=float) for m in (count, next_count)]
    first, second = ((1 - rho**m) / (m * (1 - rho)) / np.sqrt(compute_mean_variance(m, rho)) for m in sizes)
    return rho * first * second
