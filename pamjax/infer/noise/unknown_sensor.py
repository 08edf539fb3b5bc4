"""Noise of a sensor whose noise is not stated: variance and correlation, from the recording alone.

Second differences at a lag of m samples suppress smooth signals. For autocorrelated noise,
cov(s_t, s_t+k) = A ρ^k, their mean square is

    E (s_t+m − 2 s_t + s_t−m)² = A (6 − 8 ρ^m + 2 ρ^2m) + c m⁴,

with c m⁴ from the curvature of a misfit. Several lags together determine A, ρ and c; their errors follow
from ρ. The prior probability of ρ = 0 is one half; the rest is shared by the other values of
`CORRELATION_GRID`. Neglects: misfits with curvature within a few samples, noise with more than one
time constant, and correlations above 0.95, which it underestimates.
Source: derived here; covariance of mean squares of a Gaussian process, M. S. Bartlett, Suppl. J. R. Stat.
Soc. 8, 27 (1946).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import nnls
from scipy.special import logsumexp

#: Lags of the second differences, samples.
DIFFERENCE_LAGS = np.array([1, 2, 4, 8, 16])
#: Lag-one correlations that are tried.
CORRELATION_GRID = np.concatenate([[0.0], np.linspace(0.02, 0.98, 49)])
#: Quantiles at which the distribution of a variance is evaluated.
_VARIANCE_RANKS = (np.arange(12) + 0.5) / 12
#: Prior probability that a stated noise is exact, and the relative error of its variance if it is or is not.
_EXACT_PROBABILITY, _EXACT_VARIANCE_ERROR, _INEXACT_VARIANCE_ERROR = 0.7, 0.05, 0.5
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


@dataclass(frozen=True, eq=False)
class UnknownSensorNoise:
    """Estimate of a sensor's noise from a recording.

    Attributes:
        correlation_and_variance: the estimate: correlation, and variance (SI squared).
        white_variance: variance of additional white noise that is not stated, SI squared.
        support: (k, 2) possible correlations and variances, in ascending order of slow noise.
        probability: (k,) posterior probability of each of them.
    """

    correlation_and_variance: tuple[float, float]
    white_variance: float
    support: np.ndarray
    probability: np.ndarray


def estimate_unknown_noise(statistics: DifferenceStatistics) -> UnknownSensorNoise:
    """Return variance and correlation of noise from mean squares of second differences."""
    from scipy.stats import truncnorm

    # A lower bound for recordings almost free of noise, far below the stated noise.
    floor = np.maximum(1e-6 * statistics.propagated_variance, 1e-36)
    statistics = replace(statistics, mean_squares=np.maximum(statistics.mean_squares, floor))
    log_likelihood, variance, error, white = np.array(
        [_fit_correlation(k, statistics) for k in range(CORRELATION_GRID.size)]
    ).T
    prior = np.r_[0.5, np.full(CORRELATION_GRID.size - 1, 0.5 / (CORRELATION_GRID.size - 1))]
    probability = prior * np.exp(log_likelihood - log_likelihood.max())
    probability /= probability.sum()
    # The variance is normal with its error, truncated at zero.
    low = -variance / error
    sizes = variance[:, None] + error[:, None] * truncnorm.ppf(_VARIANCE_RANKS, low[:, None], np.inf)
    candidates = np.stack(np.broadcast_arrays(CORRELATION_GRID[:, None], sizes), axis=-1).reshape(-1, 2)
    order = np.argsort(candidates[:, 1] * (1 + candidates[:, 0]) / (1 - candidates[:, 0]))
    candidate_probability = np.repeat(probability / _VARIANCE_RANKS.size, _VARIANCE_RANKS.size)
    correlated_probability = float(probability[1:].sum())
    # The estimate is zero unless a positive correlation is more probable than none.
    rho = (
        float(probability[1:] @ CORRELATION_GRID[1:]) / correlated_probability
        if correlated_probability > 0.5
        else 0.0
    )
    sensor_variance, white_variance = (
        float(np.interp(rho, CORRELATION_GRID, values)) for values in (np.maximum(variance, 1e-36), white)
    )
    return UnknownSensorNoise(
        (rho, sensor_variance), white_variance, candidates[order], candidate_probability[order]
    )


@dataclass(frozen=True)
class StatedSensorNoise:
    """Noise of a sensor whose stated noise may be inexact.

    Attributes:
        correlation: correlation of neighbouring samples.
        variance: of the sensor, SI squared.
        input_factor: estimated over stated variance of the propagated noise of pressure and length.
    """

    correlation: float
    variance: float
    input_factor: float


def estimate_stated_noise(statistics: DifferenceStatistics, stated_variance: float) -> StatedSensorNoise:
    """Return the noise of a sensor from its stated noise and mean squares of second differences.

    The stated noise is exact with probability `_EXACT_PROBABILITY`. Otherwise the true variances of the
    sensor and of the propagated noise differ from the stated ones by `_INEXACT_VARIANCE_ERROR`.

    Args:
        statistics: mean squares of the residual and of the propagated noise.
        stated_variance: of the sensor, SI squared.
    """
    hypotheses = [
        _integrate_factors(statistics, stated_variance, error)
        for error in (_EXACT_VARIANCE_ERROR, _INEXACT_VARIANCE_ERROR)
    ]
    rho_prior = np.r_[0.5, np.full(CORRELATION_GRID.size - 1, 0.5 / (CORRELATION_GRID.size - 1))]
    evidence = [
        float(np.asarray(logsumexp(log_likelihood, b=rho_prior))) + math.log(prior)
        for (log_likelihood, _), prior in zip(
            hypotheses, (_EXACT_PROBABILITY, 1 - _EXACT_PROBABILITY), strict=True
        )
    ]
    log_likelihood, factors = hypotheses[int(np.argmax(evidence))]
    probability = rho_prior * np.exp(log_likelihood - log_likelihood.max())
    probability /= probability.sum()
    correlated = float(probability[1:].sum())
    rho = float(probability[1:] @ CORRELATION_GRID[1:]) / correlated if correlated > 0.5 else 0.0
    sensor, propagated = (float(np.interp(rho, CORRELATION_GRID, factors[:, j])) for j in (0, 1))
    return StatedSensorNoise(rho, max(sensor, 0.05) * stated_variance, max(propagated, 0.05))


def _integrate_factors(
    statistics: DifferenceStatistics, stated_variance: float, relative_error: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the log-likelihood of each correlation, and the posterior means of the variance factors.

    Returns:
        (grid,) log-likelihoods with the factors and the curvature integrated out, and (grid, 2) factors on
        the variance of the sensor and of the propagated noise.
    """
    floor = np.maximum(1e-6 * (statistics.propagated_variance + stated_variance), 1e-36)
    squares = np.maximum(statistics.mean_squares, floor)
    per = 1 / np.sqrt(statistics.counts)
    curvature = (DIFFERENCE_LAGS / DIFFERENCE_LAGS[-1]) ** 4 * squares[-1] / squares
    log_likelihood, factors = np.empty(CORRELATION_GRID.size), np.empty((CORRELATION_GRID.size, 2))
    prior_sd = np.array([relative_error, relative_error, 1.0])
    for k in range(CORRELATION_GRID.size):
        mean, covariance = _compute_expected_squares(k)
        design = np.stack(
            [mean * stated_variance / squares, statistics.propagated_variance / squares, curvature], axis=1
        )
        offset = 1 - design[:, 0] - design[:, 1]
        scaled = design * prior_sd
        # The relative scatter of a mean square is that of its expected value.
        expected = np.maximum(design[:, 0] + design[:, 1], 0.1)
        scatter = covariance * np.outer(per * expected, per * expected)
        total = scatter + scaled @ scaled.T
        root = np.linalg.cholesky(total + 1e-12 * np.eye(per.size))
        white = solve_triangular(root, offset, lower=True)
        log_likelihood[k] = -0.5 * float(white @ white) - float(np.log(np.diag(root)).sum())
        shift = prior_sd * (scaled.T @ solve_triangular(root.T, white, lower=False))
        factors[k] = 1 + shift[:2]
    return log_likelihood, factors


def _fit_correlation(k: int, statistics: DifferenceStatistics) -> tuple[float, float, float, float]:
    """Return the log-likelihood of one correlation, the variance, its error, and other white variance."""
    mean, covariance = _compute_expected_squares(k)
    squares, per = statistics.mean_squares, 1 / np.sqrt(statistics.counts)
    # All terms are relative to the measured mean squares.
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
    own_column = design[:, 0] - other_columns @ np.linalg.lstsq(other_columns, design[:, 0])[0]
    unconstrained_variance = own_column @ target / (own_column @ own_column)
    log_likelihood = -0.5 * residual_norm**2 - np.log(np.diag(root)).sum()
    return (
        float(log_likelihood),
        float(unconstrained_variance if variance == 0 else variance),
        float((own_column @ own_column) ** -0.5),
        sum(rest[1:]),
    )


@cache
def _compute_expected_squares(k: int) -> tuple[np.ndarray, np.ndarray]:
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
