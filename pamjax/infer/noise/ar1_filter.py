"""Noise of one channel that partly repeats itself, and the filter that makes it white.

A channel's noise is taken as its sensor's, which may repeat itself from sample to sample,

    cov(s_t, s_t+k) = A ρ^k,        k >= 1,        of the standardised residual s,

on top of what pressure's and length's noise carry through the model, which does not: W = 1 − A. The Kalman
filter of that process is

    e_1 = s_1,    e_t+1 = s_t+1 − ρ s_t + ρ (1 − K_t) e_t,    K_t = p_t / (p_t + W),
    p_1 = A,      p_t+1 = ρ² p_t W / (p_t + W) + A (1 − ρ²),

and e_t / √(p_t + W) is white. K soon is steady; until then a run is filtered by a matrix.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.signal import lfilter

from pamjax.infer.noise.unknown_sensor import UnknownSensorNoise

#: How far back the memory of noise is followed, samples.
MAX_FILTER_SAMPLES = 400

#: Share of the way from A to the steady p that is left where a filter counts as steady.
STEADY_STATE_TOLERANCE = 1e-3


@dataclass(frozen=True)
class Ar1Noise:
    """Noise of one channel.

    Attributes:
        sd: (n,) effective standard deviation of each sample, SI.
        ar1_fraction: A, the share of the variance that repeats itself.
        correlation: ρ, of neighbouring samples of that share.
        stated: whether the sensor's noise was stated.
        degrees_of_freedom: how many independent squares tell the noise; infinite where it was stated.
        rho_from_differences: ρ as neighbours' differences tell it, whether it counts as seen or not.
        unknown_sensor: what size and memory might be, of a sensor of which nothing was stated.
    """

    sd: np.ndarray
    ar1_fraction: float
    correlation: float
    stated: bool
    degrees_of_freedom: float = math.inf
    rho_from_differences: float = 0.0
    unknown_sensor: UnknownSensorNoise | None = None

    @property
    def filter(self) -> tuple[float, float]:
        """θ of the steady moving average, and the standard deviation √S of what is left of a unit sample."""
        return _solve_steady_filter(self.ar1_fraction, self.correlation)

    def whiten(self, run: np.ndarray) -> np.ndarray:
        """A run of standardised samples, (…, m), filtered: white, of unit variance."""
        rho = self.correlation
        if rho == 0 or self.ar1_fraction == 0:
            return run
        theta, innovation_sd = self.filter
        initial = _build_initial_filter(self.ar1_fraction, rho)
        m = min(len(initial.sd), run.shape[-1])
        first = run[..., :m] @ initial.filter[:m, :m].T
        if m == run.shape[-1]:
            return first
        last = -rho * run[..., m - 1] + theta * initial.sd[-1] * first[..., m - 1]
        later, _ = lfilter([1.0, -rho], [1.0, -theta], run[..., m:], axis=-1, zi=last[..., None])
        return np.concatenate([first, np.asarray(later) / innovation_sd], axis=-1)

    def sum_log_sd(self, samples: int) -> float:
        """Sum over a run of the logarithms of what each is divided by."""
        if self.correlation == 0 or self.ar1_fraction == 0:
            return 0.0
        initial = np.log(_build_initial_filter(self.ar1_fraction, self.correlation).sd[:samples])
        return float(initial.sum()) + (samples - initial.size) * math.log(self.filter[1])


@dataclass(frozen=True, eq=False)
class _InitialFilter:
    """The filter of a run's first samples.

    Attributes:
        filter: (m, m) lower triangular, from samples to white ones.
        sd: (m,) √(p_t + W), by which innovations were divided.
    """

    filter: np.ndarray
    sd: np.ndarray


@lru_cache(maxsize=256)
def _solve_steady_filter(ar1_fraction: float, rho: float) -> tuple[float, float]:
    white_fraction = 1 - ar1_fraction
    if rho == 0 or ar1_fraction == 0:
        return rho, 1.0
    driving_variance = ar1_fraction * (1 - rho**2)
    # Steady Riccati equation p = ρ² p W / (p + W) + push, a quadratic.
    b = white_fraction * (1 - rho**2) - driving_variance
    p = (-b + math.sqrt(b * b + 4 * driving_variance * white_fraction)) / 2
    return rho * white_fraction / (p + white_fraction), math.sqrt(p + white_fraction)


@lru_cache(maxsize=64)
def _build_initial_filter(ar1_fraction: float, rho: float) -> _InitialFilter:
    white_fraction, p = 1 - ar1_fraction, ar1_fraction
    steady = _solve_steady_filter(ar1_fraction, rho)[1] ** 2 - white_fraction
    rows, sd = [np.ones(1)], [1.0]
    while (
        abs(p - steady) > STEADY_STATE_TOLERANCE * max(ar1_fraction - steady, 1e-9)
        and len(sd) < MAX_FILTER_SAMPLES
    ):
        # The innovation as a sum over the samples up to it.
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
    """Standard error of ρ as neighbours' differences tell it, with A known.

    Half the mean square of n differences with autocovariances r_k has the variance Σ r_k² / 2n, over all k.
    """
    noise = ar1_fraction * correlation ** np.arange(MAX_FILTER_SAMPLES + 2)
    noise[0] = 1.0
    steps = 2 * noise[:-1] - np.r_[noise[1], noise[:-2]] - noise[1:]
    return math.sqrt((steps[0] ** 2 + 2 * float(np.sum(steps[1:] ** 2))) / (2 * samples)) / ar1_fraction
