"""Is a chain good enough: effective samples, split-R̂, autocorrelation time.

    R̂   = sqrt(variance of all half chains together / mean variance within one) of the ranks' normal scores
    ESS = chains × draws / τ,     τ = 1 + 2 Σ ρ_t   summed over pairs while they stay positive and fall

Source: Vehtari, Gelman, Simpson, Carpenter & Bürkner, Bayesian Anal. 16, 667 (2021), Eqs. 4, 10-14.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.special import ndtri
from scipy.stats import rankdata

#: Share of the draws, from the start, in which walkers may still be on their way.
BURN_IN_SHARE = 0.2
#: An autocorrelation time is trusted if the kept chain is this many times as long (emcee's advice).
MIN_CHAIN_AUTOCORRELATION_TIMES = 50


@dataclass(frozen=True)
class ConvergenceDiagnostics:
    """How far a chain can be trusted, for each number.

    Attributes:
        ess: effective samples of the mean.
        rhat: split-R̂ of normal scores.
        autocorrelation_time: autocorrelation time, draws.
        chain_length: kept draws of one chain.
    """

    ess: np.ndarray
    rhat: np.ndarray
    autocorrelation_time: np.ndarray
    chain_length: int

    def is_converged(self, ess: float, rhat: float, check_length: bool) -> bool:
        """Whether every number has enough; `check_length` asks for a trusted autocorrelation time too."""
        enough = bool(np.all(self.ess >= ess) and np.all(self.rhat <= rhat))
        return enough and (
            not check_length
            or bool(self.chain_length >= MIN_CHAIN_AUTOCORRELATION_TIMES * self.autocorrelation_time.max())
        )


def discard_burn_in(draws: np.ndarray) -> np.ndarray:
    """The draws without their first fifth; (n, chains, p)."""
    return draws[int(BURN_IN_SHARE * len(draws)) :]


def compute_convergence(draws: np.ndarray) -> ConvergenceDiagnostics:
    """Look at kept draws, (n, chains, p)."""
    n, chains, count = draws.shape
    half = n // 2
    halves = np.concatenate([draws[:half], draws[n - half :]], axis=1)
    ess = np.array([compute_ess(draws[:, :, k]) for k in range(count)])
    rhat = np.array([_compute_rhat(_compute_normal_scores(halves[:, :, k])) for k in range(count)])
    return ConvergenceDiagnostics(ess, rhat, n * chains / ess, n)


def compute_ess(x: np.ndarray) -> float:
    """Effective samples of the mean of (n, chains) draws, split into halves."""
    half = len(x) // 2
    x = np.concatenate([x[:half], x[len(x) - half :]], axis=1)
    n, chains = x.shape
    within, total = _compute_variances(x)
    if n < 4 or not within > 0:
        return 1.0
    covariance = _compute_autocovariance(x).mean(axis=1)
    rho = 1 - (within - covariance) / total
    rho[0] = 1.0
    pairs = rho[: n // 2 * 2].reshape(-1, 2).sum(axis=1)
    negative = np.flatnonzero(pairs <= 0)
    pairs = np.minimum.accumulate(pairs[: negative[0]] if negative.size else pairs)
    time = max(-1 + 2 * pairs.sum(), 1 / np.log10(n * chains))
    return n * chains / time


def _compute_variances(x: np.ndarray) -> tuple[float, float]:
    """Mean variance within a chain, and of all chains together."""
    n = len(x)
    within = float(x.var(axis=0, ddof=1).mean())
    between = float(x.mean(axis=0).var(ddof=1)) if x.shape[1] > 1 else 0.0
    return within, within * (n - 1) / n + between


def _compute_rhat(x: np.ndarray) -> float:
    within, total = _compute_variances(x)
    return float(np.sqrt(total / within)) if within > 0 else np.inf


def _compute_normal_scores(x: np.ndarray) -> np.ndarray:
    rank = rankdata(x).reshape(x.shape)
    return ndtri((rank - 0.375) / (x.size + 0.25))


def _compute_autocovariance(x: np.ndarray) -> np.ndarray:
    """At every lag, of every chain, (n, chains)."""
    n = len(x)
    size = 1 << (2 * n - 1).bit_length()
    spectrum = np.abs(np.fft.rfft(x - x.mean(axis=0), size, axis=0)) ** 2
    return np.fft.irfft(spectrum, size, axis=0)[:n] / n
