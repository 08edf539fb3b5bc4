"""Leave-one-out by importance: what a posterior that never saw a block would have said of it.

Draws weighed by one over the block's likelihood are draws of the posterior without it. The largest weights
are smoothed by a generalised Pareto law; its shape k̂ tells whether that can be trusted (below 0.7) or the
block had moved the posterior too far.

Sources: Vehtari, Simpson, Gelman, Yao & Gabry, J. Mach. Learn. Res. 25 (72), 1 (2024); the fit of the law,
Zhang & Stephens, Technometrics 51, 316 (2009).
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import logsumexp

#: A shape above this is not to be trusted.
MAX_PARETO_K = 0.7


def compute_loo_score(log_likelihood: np.ndarray) -> tuple[float, float]:
    """Log predictive density of a block by draws that did not see it, and the shape k̂.

    Args:
        log_likelihood: (draws,) of the block.
    """
    log_weights, shape = smooth_log_weights(-log_likelihood)
    score, whole = (np.asarray(logsumexp(w)) for w in (log_weights + log_likelihood, log_weights))
    return float(score - whole), shape


def smooth_log_weights(log_ratios: np.ndarray) -> tuple[np.ndarray, float]:
    """Log-weights with their tail smoothed, and the tail's shape."""
    log_weights = log_ratios - log_ratios.max()
    count = len(log_weights)
    tail = math.ceil(min(0.2 * count, 3 * math.sqrt(count)))
    order = np.argsort(log_weights)
    top, cut = order[-tail:], log_weights[order[-tail - 1]]
    beyond = np.exp(log_weights[top]) - np.exp(cut)
    if tail < 5 or not beyond[0] > 0:
        return log_weights, math.inf if tail < 5 else 0.0
    shape, scale = fit_pareto(beyond)
    if not math.isfinite(shape):
        return log_weights, math.inf
    share = (np.arange(tail) + 0.5) / tail
    quantile = (
        -scale * np.log1p(-share) if shape == 0 else scale * np.expm1(-shape * np.log1p(-share)) / shape
    )
    log_weights = log_weights.copy()
    # No weight may exceed the largest there was.
    log_weights[top] = np.minimum(np.log(quantile + np.exp(cut)), 0.0)
    return log_weights, shape


def fit_pareto(x: np.ndarray) -> tuple[float, float]:
    """Shape k and scale of a generalised Pareto law for rising x > 0, with a weak prior towards k = 0.5."""
    n = len(x)
    count = 30 + int(math.sqrt(n))
    quartile = x[int(n / 4 + 0.5) - 1]
    theta = 1 / x[-1] + (1 - np.sqrt(count / (np.arange(1, count + 1) - 0.5))) / (3 * quartile)
    k = np.log1p(-theta[:, None] * x).mean(axis=1)
    likelihood = n * (np.log(-theta / k) - k - 1)
    weight = np.exp(likelihood - logsumexp(likelihood))
    mean = float(weight @ theta)
    shape = float(np.log1p(-mean * x).mean())
    return (n * shape + 10 * 0.5) / (n + 10), -shape / mean
