"""Mean squares of second differences of a residual, and their expectation for autocorrelated noise.

Second differences at a lag of m samples suppress smooth signals. For autocorrelated noise,
cov(s_t, s_t+k) = A ρ^k, their mean square is

    E (s_t+m − 2 s_t + s_t−m)² = A (6 − 8 ρ^m + 2 ρ^2m) + c m⁴,

with c m⁴ from the curvature of a misfit. Several lags together determine A, ρ and c; their errors follow
from ρ. Neglects: misfits with curvature within a few samples, noise with more than one time constant, and
correlations above 0.95, which it underestimates.
Source: derived here; covariance of mean squares of a Gaussian process, M. S. Bartlett, Suppl. J. R. Stat.
Soc. 8, 27 (1946).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from pamjax.infer.noise.sensor_posterior import CORRELATION_GRID

#: Lags of the second differences, samples.
DIFFERENCE_LAGS = np.array([1, 2, 4, 8, 16])
#: Greatest distance of two differences with correlated noise, samples.
_MAX_SAMPLES_APART = 300


@dataclass(frozen=True, eq=False)
class DifferenceStatistics:
    """Mean squares of second differences at each of `DIFFERENCE_LAGS`.

    Attributes:
        mean_squares: of the residual, SI squared.
        counts: numbers of differences.
        propagated_variance: expected part from the stated noise of pressure and length, SI squared.
        propagated_error: relative error of that part.
        allows_white_noise: whether additional white noise, which is not stated, is estimated too.
    """

    mean_squares: np.ndarray
    counts: np.ndarray
    propagated_variance: np.ndarray
    propagated_error: float
    allows_white_noise: bool = False

    def compute_curvature(self) -> np.ndarray:
        """Return the share of curvature in each mean square, (lags,), if it is all of the last one."""
        return (DIFFERENCE_LAGS / DIFFERENCE_LAGS[-1]) ** 4 * self.mean_squares[-1] / self.mean_squares


@cache
def compute_expected_squares(k: int) -> tuple[np.ndarray, np.ndarray]:
    """Return mean squares at unit variance, and their relative covariance times the sample count."""
    rho, taps, places = CORRELATION_GRID[k], np.array([1.0, -2.0, 1.0]), np.array([-1, 0, 1])
    mean = 6 - 8 * rho**DIFFERENCE_LAGS + 2 * rho ** (2 * DIFFERENCE_LAGS)
    apart = np.arange(-_MAX_SAMPLES_APART, _MAX_SAMPLES_APART + 1)
    covariance = np.empty((DIFFERENCE_LAGS.size, DIFFERENCE_LAGS.size))
    for i, m in enumerate(DIFFERENCE_LAGS):
        for j, n in enumerate(DIFFERENCE_LAGS):
            between = apart[:, None, None] + (n * places)[None, None, :] - (m * places)[None, :, None]
            shared = np.einsum("hab,a,b->h", rho ** np.abs(between), taps, taps)
            covariance[i, j] = 2 * np.sum(shared**2) / (mean[i] * mean[j])
    return mean, covariance


def compute_second_differences(values: np.ndarray, runs: np.ndarray) -> list[np.ndarray]:
    """Return second differences of (…, n) values at each of `DIFFERENCE_LAGS`, within runs.

    Args:
        values: (…, n) in order of time.
        runs: (n,) number of each sample's run.
    """
    within = [runs[2 * m :] == runs[: -2 * m] for m in DIFFERENCE_LAGS]
    return [
        (values[..., 2 * m :] - 2 * values[..., m:-m] + values[..., : -2 * m])[..., same_run]
        for m, same_run in zip(DIFFERENCE_LAGS, within, strict=True)
    ]
