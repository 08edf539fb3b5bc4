"""The noise of a sensor of which nothing was stated: its size and its memory, from the recording alone.

Second differences at a lag of m samples know little of what is smooth, and of noise that repeats itself,
cov(s_t, s_t+k) = A ρ^k, they have the mean square

    E (s_t+m − 2 s_t + s_t−m)² = A (6 − 8 ρ^m + 2 ρ^2m) + c m⁴,

c m⁴ of a misfit that bends. Several lags tell A, ρ and c apart, with an error that follows from ρ itself. ρ
may be zero, half a chance before anything was seen, or any of the others in `CORRELATION_GRID`. What it
leaves out:
misfits that bend on the scale of a few samples, noise with more than one memory, and correlations above
0.95, of which it takes too little.
Source: derived here; covariance of mean squares of a Gaussian process, M. S. Bartlett, Suppl. J. R. Stat.
Soc. 8, 27 (1946).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import nnls
from scipy.stats import truncnorm

#: Lags of the second differences, samples.
DIFFERENCE_LAGS = np.array([1, 2, 4, 8, 16])
#: Correlations of neighbours that are tried: none, and what lies between.
CORRELATION_GRID = np.concatenate([[0.0], np.linspace(0.02, 0.98, 49)])
#: Ranks at which a variance is looked at.
VARIANCE_RANKS = (np.arange(12) + 0.5) / 12
#: How far apart differences may be and still share noise, samples.
MAX_SAMPLES_APART = 300


@dataclass(frozen=True, eq=False)
class DifferenceStatistics:
    """Mean squares of second differences at each of `DIFFERENCE_LAGS`.

    Attributes:
        mean_squares: of the residual, SI squared.
        counts: how many differences there are.
        propagated_variance: what stated noise of pressure and length is expected to add.
        propagated_error: share to which that is known.
        allows_white_noise: whether there may be more white noise, of which nothing was stated.
    """

    mean_squares: np.ndarray
    counts: np.ndarray
    propagated_variance: np.ndarray
    propagated_error: float
    allows_white_noise: bool = False


@dataclass(frozen=True, eq=False)
class UnknownSensorNoise:
    """What a recording tells of a sensor's noise.

    Attributes:
        correlation_and_variance: correlation and variance (SI squared) that it is taken to have.
        white_variance: variance of other white noise, of which nothing was stated, SI squared.
        candidates: (k, 2) what correlation and variance might be, from the least slow noise to the most.
        probability: (k,) of each.
    """

    correlation_and_variance: tuple[float, float]
    white_variance: float
    candidates: np.ndarray
    probability: np.ndarray


def estimate_unknown_noise(statistics: DifferenceStatistics) -> UnknownSensorNoise:
    """Size and memory of noise from mean squares of second differences."""
    # Where a recording is all but free of noise: next to nothing beside what was stated.
    floor = np.maximum(1e-6 * statistics.propagated_variance, 1e-36)
    statistics = replace(statistics, mean_squares=np.maximum(statistics.mean_squares, floor))
    log_likelihood, variance, error, white = np.array(
        [_fit_correlation(k, statistics) for k in range(CORRELATION_GRID.size)]
    ).T
    prior = np.r_[0.5, np.full(CORRELATION_GRID.size - 1, 0.5 / (CORRELATION_GRID.size - 1))]
    probability = prior * np.exp(log_likelihood - log_likelihood.max())
    probability /= probability.sum()
    # A variance is known with its error, and is not negative.
    low = -variance / error
    sizes = variance[:, None] + error[:, None] * truncnorm.ppf(VARIANCE_RANKS, low[:, None], np.inf)
    candidates = np.stack(np.broadcast_arrays(CORRELATION_GRID[:, None], sizes), axis=-1).reshape(-1, 2)
    order = np.argsort(candidates[:, 1] * (1 + candidates[:, 0]) / (1 - candidates[:, 0]))
    candidate_probability = np.repeat(probability / VARIANCE_RANKS.size, VARIANCE_RANKS.size)
    correlated_probability = float(probability[1:].sum())
    # No correlation, unless some is more probable than none.
    rho = (
        float(probability[1:] @ CORRELATION_GRID[1:]) / correlated_probability
        if correlated_probability > 0.5
        else 0.0
    )
    own_variance, white_variance = (
        float(np.interp(rho, CORRELATION_GRID, values)) for values in (np.maximum(variance, 1e-36), white)
    )
    return UnknownSensorNoise(
        (rho, own_variance), white_variance, candidates[order], candidate_probability[order]
    )


def _fit_correlation(k: int, statistics: DifferenceStatistics) -> tuple[float, float, float, float]:
    """Log-likelihood of one correlation, the variance that goes with it, its error, and other white noise."""
    mean, covariance = _compute_expected_squares(k)
    squares, per = statistics.mean_squares, 1 / np.sqrt(statistics.counts)
    # All in shares of each square, as it was seen.
    propagated, curvature = (
        statistics.propagated_variance / squares,
        (DIFFERENCE_LAGS / DIFFERENCE_LAGS[-1]) ** 4 * squares[-1] / squares,
    )
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
    own = design[:, 0] - other_columns @ np.linalg.lstsq(other_columns, design[:, 0])[0]
    free = own @ target / (own @ own)
    log_likelihood = -0.5 * residual_norm**2 - np.log(np.diag(root)).sum()
    return (
        float(log_likelihood),
        float(free if variance == 0 else variance),
        float((own @ own) ** -0.5),
        sum(rest[1:]),
    )


@cache
def _compute_expected_squares(k: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean squares at unit variance, and their relative covariance times samples."""
    rho, taps, places = CORRELATION_GRID[k], np.array([1.0, -2.0, 1.0]), np.array([-1, 0, 1])
    mean = 6 - 8 * rho**DIFFERENCE_LAGS + 2 * rho ** (2 * DIFFERENCE_LAGS)
    apart = np.arange(-MAX_SAMPLES_APART, MAX_SAMPLES_APART + 1)
    covariance = np.empty((DIFFERENCE_LAGS.size, DIFFERENCE_LAGS.size))
    for i, m in enumerate(DIFFERENCE_LAGS):
        for j, n in enumerate(DIFFERENCE_LAGS):
            between = apart[:, None, None] + (n * places)[None, None, :] - (m * places)[None, :, None]
            shared = np.einsum("hab,a,b->h", rho ** np.abs(between), taps, taps)
            covariance[i, j] = 2 * np.sum(shared**2) / (mean[i] * mean[j])
    return mean, covariance


def compute_second_differences(values: np.ndarray, runs: np.ndarray) -> list[np.ndarray]:
    """Second differences of (…, n) values at each of `DIFFERENCE_LAGS`, within runs.

    Args:
        values: one after the other.
        runs: (n,) number of each sample's run.
    """
    within = [runs[2 * m :] == runs[: -2 * m] for m in DIFFERENCE_LAGS]
    return [
        (values[..., 2 * m :] - 2 * values[..., m:-m] + values[..., : -2 * m])[..., same_run]
        for m, same_run in zip(DIFFERENCE_LAGS, within, strict=True)
    ]
