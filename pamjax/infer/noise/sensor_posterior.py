"""Posterior distribution of a sensor's noise: its correlation and variance together.

The correlation ρ has a grid of values. The prior probability of ρ = 0 is one half; the other values share the
rest. At each ρ the variance has a normal distribution, truncated at zero, which a few quantiles represent.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: Lag-one correlations that are tried, and their prior probabilities.
CORRELATION_GRID = np.concatenate([[0.0], np.linspace(0.02, 0.98, 49)])
CORRELATION_PRIOR = np.r_[0.5, np.full(CORRELATION_GRID.size - 1, 0.5 / (CORRELATION_GRID.size - 1))]

#: Quantiles at which the distribution of a variance is evaluated.
_VARIANCE_RANKS = (np.arange(12) + 0.5) / 12


@dataclass(frozen=True, eq=False)
class SensorPosterior:
    """Posterior distribution of a sensor's noise.

    Attributes:
        correlation: the estimate of the correlation; zero unless a positive value is more probable.
        variance: the estimate of the variance, SI squared.
        support: (k, 2) possible correlations and variances, in ascending order of slow noise.
        probability: (k,) posterior probability of each of them.
    """

    correlation: float
    variance: float
    support: np.ndarray
    probability: np.ndarray


def estimate_correlation(probability: np.ndarray) -> float:
    """Return the mean of the positive correlations, or zero if they are less probable than none.

    Args:
        probability: (grid,) posterior probability of each value of `CORRELATION_GRID`.
    """
    positive = float(probability[1:].sum())
    return float(probability[1:] @ CORRELATION_GRID[1:]) / positive if positive > 0.5 else 0.0


def build_sensor_posterior(
    correlation: float, variance: float, probability: np.ndarray, means: np.ndarray, errors: np.ndarray
) -> SensorPosterior:
    """Return the posterior from the distributions of the variance at each correlation.

    Args:
        correlation: the estimate of the correlation.
        variance: the estimate of the variance, SI squared.
        probability: (…, grid) posterior probability of each hypothesis and each value of `CORRELATION_GRID`.
        means: (…, grid) mean of the variance before truncation, SI squared.
        errors: (…, grid) its standard deviation, SI squared.
    """
    # Imported here: SciPy's distributions take longer to load than a small fit.
    from scipy.stats import truncnorm

    quantiles = truncnorm.ppf(_VARIANCE_RANKS, (-means / errors)[..., None], np.inf)
    variances = means[..., None] + errors[..., None] * quantiles
    correlations = np.broadcast_to(CORRELATION_GRID[:, None], variances.shape)
    support = np.stack([correlations, variances], axis=-1).reshape(-1, 2)
    order = np.argsort(support[:, 1] * (1 + support[:, 0]) / (1 - support[:, 0]))
    support_probability = np.repeat(probability.ravel() / _VARIANCE_RANKS.size, _VARIANCE_RANKS.size)
    return SensorPosterior(correlation, variance, support[order], support_probability[order])
