"""Convergence of a chain: effective sample size, split-R̂ and autocorrelation time.

    R̂   = sqrt(variance of all half chains together / mean variance within one) of the ranks' normal scores
    ESS = chains × draws / τ,     τ = 1 + 2 Σ ρ(t), the integrated autocorrelation time, draws

arviz-stats computes R̂ and ESS of the mean.

Source: Vehtari, Gelman, Simpson, Carpenter & Bürkner, Bayesian Anal. 16, 667 (2021), Eqs. 4, 10-14.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

#: Fraction of the draws, from the start of a chain, that is discarded as burn-in.
_BURN_IN_SHARE = 0.2
#: Minimum length of a chain, in autocorrelation times, for a reliable autocorrelation time (emcee's advice).
MIN_CHAIN_AUTOCORRELATION_TIMES = 50


@dataclass(frozen=True)
class ConvergenceDiagnostics:
    """Convergence of a chain, (p,) each, for every parameter.

    Attributes:
        ess: effective sample size of the mean.
        rhat: split-R̂ of normal scores.
        autocorrelation_time: integrated autocorrelation time, draws.
        chain_length: draws of one chain, without burn-in.
    """

    ess: np.ndarray
    rhat: np.ndarray
    autocorrelation_time: np.ndarray
    chain_length: int

    def is_converged(self, ess: float, rhat: float, check_length: bool) -> bool:
        """Return whether every parameter meets both targets.

        Args:
            ess: smallest effective sample size.
            rhat: largest split-R̂.
            check_length: whether the chain must also be long enough for its autocorrelation time.
        """
        meets_targets = bool(np.all(self.ess >= ess) and np.all(self.rhat <= rhat))
        return meets_targets and (
            not check_length
            or bool(self.chain_length >= MIN_CHAIN_AUTOCORRELATION_TIMES * self.autocorrelation_time.max())
        )


def discard_burn_in(draws: np.ndarray) -> np.ndarray:
    """Return the draws without their first fifth; (n, chains, p)."""
    return draws[int(_BURN_IN_SHARE * len(draws)) :]


def compute_convergence(draws: np.ndarray) -> ConvergenceDiagnostics:
    """Return the convergence diagnostics of draws without burn-in, (n, chains, p).

    A parameter that never changes has an infinite R̂ and one effective sample.
    """
    from arviz_stats.base import array_stats

    n, chains, _ = draws.shape
    is_constant = np.ptp(draws, axis=(0, 1)) == 0
    with np.errstate(divide="ignore", invalid="ignore"):
        ess = array_stats.ess(draws, chain_axis=1, draw_axis=0, method="mean")
        rhat = array_stats.rhat(draws, chain_axis=1, draw_axis=0, method="z_scale")
    ess, rhat = np.where(is_constant, 1.0, ess), np.where(is_constant, np.inf, rhat)
    return ConvergenceDiagnostics(ess, rhat, n * chains / ess, n)
