"""AR(1) noise with additional white noise, and the filter that whitens it.

The standardised residual s has a part with AR(1) autocorrelation, of variance A: the sensor's noise,

    cov(s_t, s_t+k) = A ρ^k,        k >= 1,

and a white part of variance W = 1 − A: the propagated noise of pressure and length. The Kalman filter is

    e_1 = s_1,    e_t+1 = s_t+1 − ρ s_t + ρ (1 − K_t) e_t,    K_t = p_t / (p_t + W),
    p_1 = A,      p_t+1 = ρ² p_t W / (p_t + W) + A (1 − ρ²),

and e_t / √(p_t + W) is white. K is computed for the first samples of a run, until it is steady.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from scipy.linalg import get_lapack_funcs

from pamjax.infer.noise.sensor_posterior import SensorPosterior

#: Maximum number of samples before the filter counts as steady, and of lags of the autocovariance.
_MAX_FILTER_SAMPLES = 400

#: A filter is steady if p differs from its steady value by less than this fraction of the initial difference.
_STEADY_STATE_TOLERANCE = 1e-3

#: LAPACK's solution of linear equations with a triangular band matrix.
(_solve_triangular_band,) = get_lapack_funcs(("tbtrs",), dtype=np.float64)


@dataclass(frozen=True, eq=False)
class SampleNoise:
    """Autocorrelated noise that differs between samples, such as means of different numbers of readings.

    Attributes:
        ar1_fraction: (n,) A of each sample.
        correlation: (n,) correlation of the autocorrelated part with that of the sample before.
    """

    ar1_fraction: np.ndarray
    correlation: np.ndarray

    def select(self, rows: np.ndarray | None) -> SampleNoise:
        """Return the noise of some samples."""
        assert rows is not None
        return SampleNoise(self.ar1_fraction[rows], self.correlation[rows])

    def build_filter(self, runs: np.ndarray) -> RunFilter:
        """Return the filter of consecutive runs, (k, 2) begin and end, with A, W and ρ of each sample."""
        fraction, rho = self.ar1_fraction, self.correlation.copy()
        rho[runs[:, 0]] = 0.0
        # The state is the autocorrelated part itself, and not relative to its sd.
        factor = rho.copy()
        factor[1:] *= np.sqrt(fraction[1:] / np.maximum(fraction[:-1], 1e-12))
        feedback, variance, p, remaining = [], [], 0.0, 0.0
        # Lists: single elements of arrays are slow.
        values = (x.tolist() for x in (factor, fraction * (1 - rho**2), 1 - fraction))
        for phi, driving_variance, white in zip(*values, strict=True):
            feedback.append(phi * remaining)
            p = phi**2 * p * remaining + driving_variance
            variance.append(p + white)
            remaining = white / (p + white)
        return RunFilter(factor, np.array(feedback), np.sqrt(variance))


@dataclass(frozen=True)
class Ar1Noise:
    """Noise of one channel.

    Attributes:
        sd: (n,) effective standard deviation of each sample, SI.
        ar1_fraction: A, the autocorrelated fraction of the variance.
        correlation: ρ, lag-one correlation of that fraction.
        is_stated: whether muscle.toml states the sensor's noise.
        degrees_of_freedom: degrees of freedom of the variance; infinite if it is stated.
        rho_from_differences: ρ from differences of neighbours, also where it is not significant.
        sensor_posterior: posterior of variance and correlation, if the recording determines the variance.
        by_sample: fraction and correlation of each sample, if they differ; the others are their means.
    """

    sd: np.ndarray
    ar1_fraction: float
    correlation: float
    is_stated: bool
    degrees_of_freedom: float = math.inf
    rho_from_differences: float = 0.0
    sensor_posterior: SensorPosterior | None = None
    by_sample: SampleNoise | None = None

    @property
    def filter(self) -> tuple[float, float]:
        """Return the coefficient θ of the steady filter, and the sd of the innovation of a unit sample."""
        return _solve_steady_filter(self.ar1_fraction, self.correlation)

    def build_filter(self, runs: np.ndarray, rows: np.ndarray | None = None) -> RunFilter | None:
        """Return the filter of consecutive runs; None for uncorrelated noise.

        Args:
            runs: (k, 2) begin and end of each run in `rows`.
            rows: samples in use; needed if the noise differs between samples.
        """
        if self.correlation == 0 or self.ar1_fraction == 0:
            return None
        if self.by_sample is not None:
            return self.by_sample.select(rows).build_filter(runs)
        lengths = runs[:, 1] - runs[:, 0]
        feedback, sd = self.compute_coefficients(int(lengths.max(initial=0)))
        # The number of each sample in its run; none if the channel has no rows in use.
        sample = np.arange(lengths.sum()) - np.repeat(np.cumsum(lengths) - lengths, lengths)
        return RunFilter(np.where(sample == 0, 0.0, self.correlation), feedback[sample], sd[sample])

    def compute_coefficients(self, samples: int) -> tuple[np.ndarray, np.ndarray]:
        """Return ρ (1 − K) before each sample of a run, and the sd of its innovation, (samples,) each."""
        rho, sd = self.correlation, np.ones(samples)
        if rho == 0 or self.ar1_fraction == 0:
            return np.zeros(samples), sd
        initial = _compute_initial_sds(self.ar1_fraction, rho)[:samples]
        sd[: initial.size], sd[initial.size :] = initial, self.filter[1]
        feedback = rho * (1 - self.ar1_fraction) / sd**2
        return np.concatenate([[0.0], feedback])[:samples], sd


@dataclass(frozen=True, eq=False)
class RunFilter:
    """Filter of the samples of consecutive runs; it restarts at each run.

    Attributes:
        correlation: (n,) ρ between each sample and the one before; zero at the first sample of a run.
        feedback: (n,) ρ (1 − K) before each sample; zero at the first sample of a run.
        sd: (n,) √(p_t + W), the sds of the innovations.
    """

    correlation: np.ndarray
    feedback: np.ndarray
    sd: np.ndarray

    @cached_property
    def _band(self) -> np.ndarray:
        """Return the recursion as a matrix with ones on its diagonal: that and the band below, (2, n)."""
        below = np.append(-self.feedback[1:], 0.0)
        return np.asfortranarray([np.ones(self.sd.size), below])

    def whiten(self, samples: np.ndarray) -> np.ndarray:
        """Return the whitened samples, (…, n), with unit variance.

        A missing sample, NaN, makes the later samples of its run NaN.
        """
        is_missing = ~np.isfinite(samples)
        if not is_missing.any():
            return self._whiten_finite(samples)
        row = np.arange(self.sd.size)
        run_start = np.maximum.accumulate(np.where(self.correlation == 0, row, 0))
        last_missing = np.maximum.accumulate(np.where(is_missing, row, -1), axis=-1)
        white = self._whiten_finite(np.where(is_missing, 0.0, samples))
        return np.where(last_missing >= run_start, np.nan, white)

    def _whiten_finite(self, samples: np.ndarray) -> np.ndarray:
        # Without samples, LAPACK would write to memory that is not its own.
        if not samples.size:
            return np.zeros(samples.shape)
        change = np.array(samples, dtype=float).reshape(-1, self.sd.size)
        change[:, 1:] -= self.correlation[1:] * samples.reshape(change.shape)[:, :-1]
        # One call for all runs and rows: each has less work than a call.
        innovation, _ = _solve_triangular_band(self._band, change.T, uplo="L", diag="U", overwrite_b=True)
        return (innovation.T / self.sd).reshape(samples.shape)


@lru_cache(maxsize=256)
def _solve_steady_filter(ar1_fraction: float, rho: float) -> tuple[float, float]:
    white_fraction = 1 - ar1_fraction
    if rho == 0 or ar1_fraction == 0:
        return rho, 1.0
    driving_variance = ar1_fraction * (1 - rho**2)
    # The steady Riccati equation p = ρ² p W / (p + W) + A (1 − ρ²) is quadratic.
    b = white_fraction * (1 - rho**2) - driving_variance
    p = (-b + math.sqrt(b * b + 4 * driving_variance * white_fraction)) / 2
    return rho * white_fraction / (p + white_fraction), math.sqrt(p + white_fraction)


@lru_cache(maxsize=64)
def _compute_initial_sds(ar1_fraction: float, rho: float) -> np.ndarray:
    """Return the sds of the innovations of a run's first samples, until they are steady."""
    white_fraction, p = 1 - ar1_fraction, ar1_fraction
    steady, sd = _solve_steady_filter(ar1_fraction, rho)[1] ** 2 - white_fraction, [1.0]
    while (
        abs(p - steady) > _STEADY_STATE_TOLERANCE * max(ar1_fraction - steady, 1e-9)
        and len(sd) < _MAX_FILTER_SAMPLES
    ):
        p = rho**2 * p * white_fraction / (p + white_fraction) + ar1_fraction * (1 - rho**2)
        sd.append(math.sqrt(p + white_fraction))
    return np.array(sd)


def compute_correlation_error(ar1_fraction: float, correlation: float, samples: int) -> float:
    """Return the standard error of ρ from differences of neighbours, with A known.

    The variance of half the mean square of n differences with autocovariances r_k is Σ r_k² / 2n, over all k.
    """
    covariance = ar1_fraction * correlation ** np.arange(_MAX_FILTER_SAMPLES + 2)
    covariance[0] = 1.0
    r = 2 * covariance[:-1] - np.r_[covariance[1], covariance[:-2]] - covariance[1:]
    return math.sqrt((r[0] ** 2 + 2 * float(np.sum(r[1:] ** 2))) / (2 * samples)) / ar1_fraction
