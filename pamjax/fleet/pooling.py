"""Partial pooling: the distribution of a parameter over specimens, without the specimens' own uncertainty.

Specimen i has the estimate yᵢ ± sᵢ and the true value θᵢ:

    yᵢ ~ N(θᵢ, sᵢ²),    θᵢ ~ N(μ, τ²)

The sd between specimens τ has the largest restricted likelihood ℓ(τ) of `restricted_likelihood.py`. Its
interval has all values with ℓ within 1.92 of the maximum (95 %). The estimate of a specimen moves towards the
mean by its share sᵢ² / (τ² + sᵢ²). Neglected: correlation between the parameters of one specimen, and
distributions with heavy tails.

Source: A. Gelman et al., Bayesian Data Analysis, 3rd ed. (2013), section 5.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from pamjax.errors import BadInput
from pamjax.fleet.restricted_likelihood import compute_log_likelihoods, fit_coefficients

#: Number of values of τ in the first and in each finer grid.
_GRID_SIZE = 120
#: Number of finer grids around the maximum.
_REFINEMENTS = 2
#: Fall of the log-likelihood at the ends of the 95 % interval.
_PROFILE_FALL = float(stats.chi2.ppf(0.95, 1)) / 2
#: Smallest number of specimens of a distribution.
MIN_SPECIMENS = 3
#: Probability of any false alarm among all specimens of all distributions.
_OUTLIER_P_VALUE = 0.05


@dataclass(frozen=True, eq=False)
class PooledParameter:
    """Distribution of one parameter over specimens.

    Attributes:
        mean, mean_sd: mean over specimens and its sd.
        between_sd: sd between specimens, τ.
        between_interval: its 95 % profile interval.
        estimate, sd: (n,) estimates of the specimens and their sd.
        shrunken, shrunken_sd: (n,) the same after partial pooling.
        deviation: (n,) difference to the prediction from the other specimens, in sd of this difference.
        p_value: (n,) two-sided p-value of the deviation, from Student's t with n − 2 degrees of freedom.
        distribution_count: number of distributions that are searched for outliers.
    """

    mean: float
    mean_sd: float
    between_sd: float
    between_interval: tuple[float, float]
    estimate: np.ndarray
    sd: np.ndarray
    shrunken: np.ndarray
    shrunken_sd: np.ndarray
    deviation: np.ndarray
    p_value: np.ndarray
    distribution_count: int = 1

    @property
    def outliers(self) -> np.ndarray:
        """Return (n,) whether a specimen is an outlier.

        The Bonferroni correction is for all specimens of all distributions.
        """
        return self.p_value * len(self.p_value) * self.distribution_count < _OUTLIER_P_VALUE


def pool_estimates(estimate: np.ndarray, sd: np.ndarray, distribution_count: int = 1) -> PooledParameter:
    """Return the distribution over specimens.

    Args:
        estimate: (n,) estimates of independent specimens.
        sd: (n,) their standard deviations, positive.
        distribution_count: number of distributions that are searched for outliers.

    Raises:
        BadInput: for fewer than `MIN_SPECIMENS` specimens, or an sd that is not positive.

    >>> pooled = pool_estimates(np.array([9.0, 10.0, 11.0]), np.full(3, 0.1))
    >>> round(pooled.mean, 6), round(pooled.between_sd, 3)
    (10.0, 0.995)
    """
    estimate, sd = np.asarray(estimate, float), np.asarray(sd, float)
    if len(estimate) < MIN_SPECIMENS:
        rule = f"a distribution needs {MIN_SPECIMENS} specimens"
        raise BadInput.from_rule(rule, f"{len(estimate)}", remedy="Add specimens.")
    if not (np.isfinite(estimate).all() and np.isfinite(sd).all() and (sd > 0).all()):
        raise BadInput.from_rule(
            "estimates must be finite, and their sd positive", remedy="Remove the other estimates."
        )
    # Relative to its median, a parameter with a large mean keeps its digits.
    centre, scale = float(np.median(estimate)), float(np.ptp(estimate) + sd.max())
    y, s = (estimate - centre) / scale, sd / scale
    tau, interval = maximise_likelihood(y, s)
    coefficients, covariance = fit_coefficients(y, s, np.ones((len(y), 1)), tau)
    mean, mean_sd = float(coefficients[0]), float(covariance[0, 0] ** 0.5)
    share = s**2 / (s**2 + tau**2)
    deviation, p_value = _compare_with_others(y, s)
    return PooledParameter(
        mean=centre + scale * mean,
        mean_sd=scale * mean_sd,
        between_sd=scale * tau,
        between_interval=(scale * interval[0], scale * interval[1]),
        estimate=estimate,
        sd=sd,
        shrunken=centre + scale * (share * mean + (1 - share) * y),
        shrunken_sd=scale * np.sqrt((1 - share) * s**2 + (share * mean_sd) ** 2),
        deviation=deviation,
        p_value=p_value,
        distribution_count=distribution_count,
    )


def maximise_likelihood(y: np.ndarray, s: np.ndarray) -> tuple[float, tuple[float, float]]:
    """Return τ of the largest restricted likelihood, and its 95 % profile interval.

    Args:
        y: (n,) estimates.
        s: (n,) their sd.
    """
    grid = _build_grid(y, s)
    for _ in range(_REFINEMENTS):
        k = int(np.argmax(_compute_log_likelihoods(y, s, grid)))
        grid = np.linspace(grid[max(k - 1, 0)], grid[min(k + 1, len(grid) - 1)], _GRID_SIZE)
    values = _compute_log_likelihoods(y, s, grid)
    tau, top = float(grid[np.argmax(values)]), float(values.max())
    wide = np.unique(np.append(_build_grid(y, s, 40.0), tau))
    inside = wide[_compute_log_likelihoods(y, s, wide) >= top - _PROFILE_FALL]
    return tau, (
        _find_crossing(y, s, wide, float(inside[0]), top, -1),
        _find_crossing(y, s, wide, float(inside[-1]), top, 1),
    )


def _find_crossing(
    y: np.ndarray, s: np.ndarray, grid: np.ndarray, edge: float, top: float, direction: int
) -> float:
    """Return the value between `edge` and its neighbour in the grid at which the likelihood has fallen."""
    k = int(np.searchsorted(grid, edge)) + direction
    if not 0 <= k < len(grid):
        return edge
    inner, outer = edge, float(grid[k])
    for _ in range(40):
        middle = (inner + outer) / 2
        is_inside = _compute_log_likelihoods(y, s, np.array([middle]))[0] >= top - _PROFILE_FALL
        inner, outer = (middle, outer) if is_inside else (inner, middle)
    return inner


def _build_grid(y: np.ndarray, s: np.ndarray, factor: float = 3.0) -> np.ndarray:
    """Return values of τ from zero to `factor` times the range of the estimates."""
    high = factor * max(float(np.ptp(y)), float(s.min()))
    return np.concatenate([[0.0], np.geomspace(1e-4 * high / factor, high, _GRID_SIZE)])


def _compute_log_likelihoods(y: np.ndarray, s: np.ndarray, taus: np.ndarray) -> np.ndarray:
    """Return (m,) restricted log-likelihoods of (m,) values of τ, with a common mean."""
    return compute_log_likelihoods(y, s, np.ones((len(y), 1)), taus)


def _compare_with_others(y: np.ndarray, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return deviation and p-value of each specimen from the distribution of all others.

    The likelihood without specimen i follows from the sums of all specimens minus its own terms.
    """
    taus = _build_grid(y, s)
    best_value = np.full(len(y), -np.inf)
    best_mean, best_variance = np.zeros(len(y)), np.ones(len(y))
    for tau in taus:
        variance = tau**2 + s**2
        weight = 1 / variance
        total = weight.sum() - weight
        mean = ((weight * y).sum() - weight * y) / total
        square = (weight * y**2).sum() - weight * y**2 - total * mean**2
        value = -0.5 * (np.log(variance).sum() - np.log(variance) + np.log(total) + square)
        better = value > best_value
        best_value = np.where(better, value, best_value)
        best_mean = np.where(better, mean, best_mean)
        best_variance = np.where(better, variance + 1 / total, best_variance)
    deviation = (y - best_mean) / np.sqrt(best_variance)
    return deviation, 2 * stats.t.sf(np.abs(deviation), max(len(y) - 2, 1))
