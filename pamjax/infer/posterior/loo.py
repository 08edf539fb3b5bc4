"""Leave-one-block-out score of a posterior, by Pareto-smoothed importance sampling (PSIS).

    ln p(block | the other blocks) = ln (Σ w p(block | draw) / Σ w),     w = 1 / p(block | draw)

A generalised Pareto distribution smooths the largest weights. If its shape k̂ exceeds 0.7, the score is not
reliable: the block changes the posterior too much. arviz-stats computes score and k̂.

Neglects: the autocorrelation of the draws.

Source: Vehtari, Simpson, Gelman, Yao & Gabry, J. Mach. Learn. Res. 25 (72), 1 (2024).
"""

from __future__ import annotations

import math

import numpy as np
from scipy.special import logsumexp

#: Largest shape k̂ of a reliable score.
MAX_PARETO_K = 0.7


def compute_loo_score(log_likelihood: np.ndarray) -> tuple[float, float]:
    """Return the log predictive density of a block given the other blocks, and the Pareto shape k̂.

    Where no Pareto distribution can be fitted, the weights are not smoothed and k̂ is infinite.

    Args:
        log_likelihood: (draws,) of the block.
    """
    from arviz_stats.base import array_stats

    if np.ptp(log_likelihood) == 0:
        return float(log_likelihood[0]), 0.0
    try:
        with np.errstate(all="ignore"):
            score, pareto_k, _ = array_stats.loo(log_likelihood[None], chain_axis=0, draw_axis=1)
    except ValueError:  # fewer than five weights in the tail, or all of them equal
        score = pareto_k = math.nan
    if not (np.isfinite(score) and np.isfinite(pareto_k)):
        return math.log(log_likelihood.size) - float(np.asarray(logsumexp(-log_likelihood))), math.inf
    return float(score), float(pareto_k)
