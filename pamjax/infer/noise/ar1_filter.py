"""AR(1) noise with additional white noise, and the filter that whitens it.

The standardised residual s has a part with AR(1) autocorrelation, of variance A: the sensor's noise,

    cov(s_t, s_t+k) = A ρ^k,        k >= 1,

and a white part of variance W = 1 − A: the propagated noise of pressure and length. The Kalman filter is

    e_1 = s_1,    e_t+1 = s_t+1 − ρ s_t + ρ (1 − K_t) e_t,    K_t = p_t / (p_t + W),
    p_1 = A,      p_t+1 = ρ² p_t W / (p_t + W) + A (1 − ρ²),

and e_t / √(p_t + W) is white. The first samples of a run are filtered by a matrix, until K is steady.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from pamjax.infer.noise.sensor_posterior import SensorPosterior

#: Maximum number of samples before the filter counts as steady, and of lags of the autocovariance.
_MAX_FILTER_SAMPLES = 400

#: A filter is steady if p differs from its steady value by less than this fraction of the initial difference.
_STEADY_STATE_TOLERANCE = 1e-3


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
    """

    sd: np.ndarray
    ar1_fraction: float
    correlation: float
    is_stated: bool
    degrees_of_freedom: float = math.inf
    rho_from_differences: float = 0.0
    sensor_posterior: SensorPosterior | None = None

    @property
    def filter(self) -> tuple[float, float]:
        """Return the coefficient θ of the steady filter, and the sd of the innovation of a unit sample."""
        return _solve_steady_filter(self.ar1_fraction, self.correlation)

    def whiten(self, run: np.ndarray) -> np.ndarray:
        """Return the whitened samples of a run, (…, m), with unit variance."""
        rho = self.correlation
        if rho == 0 or self.ar1_fraction == 0:
            return run
        theta, innovation_sd = self.filter
        initial = _build_initial_filter(self.ar1_fraction, rho)
        m = min(len(initial.sd), run.shape[-1])
        first = run[..., :m] @ initial.filter[:m, :m].T
        if m == run.shape[-1]:
            return first
        # Imported here: SciPy's signal package takes longer to load than a small fit.
        from scipy.signal import lfilter

        filter_state = -rho * run[..., m - 1] + theta * initial.sd[-1] * first[..., m - 1]
        later, _ = lfilter([1.0, -rho], [1.0, -theta], run[..., m:], axis=-1, zi=filter_state[..., None])
        return np.concatenate([first, np.asarray(later) / innovation_sd], axis=-1)

    def compute_coefficients(self, samples: int) -> tuple[np.ndarray, np.ndarray]:
        """Return ρ (1 − K) before each sample of a run, and the sd of its innovation, (samples,) each."""
        rho, sd = self.correlation, np.ones(samples)
        if rho == 0 or self.ar1_fraction == 0:
            return np.zeros(samples), sd
        initial = _build_initial_filter(self.ar1_fraction, rho).sd[:samples]
        sd[: initial.size], sd[initial.size :] = initial, self.filter[1]
        feedback = rho * (1 - self.ar1_fraction) / sd**2
        return np.concatenate([[0.0], feedback])[:samples], sd

    def sum_log_sd(self, samples: int) -> float:
        """Return the sum of the logarithms of the innovation sds of a run."""
        if self.correlation == 0 or self.ar1_fraction == 0:
            return 0.0
        initial = np.log(_build_initial_filter(self.ar1_fraction, self.correlation).sd[:samples])
        return float(initial.sum()) + (samples - initial.size) * math.log(self.filter[1])


@dataclass(frozen=True, eq=False)
class _InitialFilter:
    """Filter of a run's first samples.

    Attributes:
        filter: (m, m) lower triangular matrix from samples to white samples.
        sd: (m,) √(p_t + W), the sds of the innovations.
    """

    filter: np.ndarray
    sd: np.ndarray


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
def _build_initial_filter(ar1_fraction: float, rho: float) -> _InitialFilter:
    white_fraction, p = 1 - ar1_fraction, ar1_fraction
    steady = _solve_steady_filter(ar1_fraction, rho)[1] ** 2 - white_fraction
    rows, sd = [np.ones(1)], [1.0]
    while (
        abs(p - steady) > _STEADY_STATE_TOLERANCE * max(ar1_fraction - steady, 1e-9)
        and len(sd) < _MAX_FILTER_SAMPLES
    ):
        # The innovation is a sum over the samples up to its own.
        gain = rho * white_fraction / (p + white_fraction)
        row = np.append(gain * rows[-1], 1.0)
        row[-2] -= rho
        rows.append(row)
        p = rho**2 * p * white_fraction / (p + white_fraction) + ar1_fraction * (1 - rho**2)
        sd.append(math.sqrt(p + white_fraction))
    matrix = np.zeros((len(sd), len(sd)))
    for t, row in enumerate(rows):
        matrix[t, : t + 1] = row / sd[t]
    return _InitialFilter(matrix, np.array(sd))


def compute_correlation_error(ar1_fraction: float, correlation: float, samples: int) -> float:
    """Return the standard error of ρ from differences of neighbours, with A known.

    The variance of half the mean square of n differences with autocovariances r_k is Σ r_k² / 2n, over all k.
    """
    covariance = ar1_fraction * correlation ** np.arange(_MAX_FILTER_SAMPLES + 2)
    covariance[0] = 1.0
    r = 2 * covariance[:-1] - np.r_[covariance[1], covariance[:-2]] - covariance[1:]
    return math.sqrt((r[0] ** 2 + 2 * float(np.sum(r[1:] ** 2))) / (2 * samples)) / ar1_fraction
