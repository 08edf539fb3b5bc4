"""Integrated autocorrelation time of residuals, and the factor by which a misfit increases variances.

With the integrated autocorrelation time T = 1 + 2 Σ ρ_k, n samples have the effective sample size n / T. For
a white residual T is one. A systematic misfit is smooth: its mean square s and its T are large. Then n
samples determine a parameter as badly as n / (s T) samples of noise. This approximates generalised least
squares where the sensitivities to the parameters change slowly, and needs no model of the misfit.

Libraries estimate T of Markov chains of equal length. A recording has runs of different lengths, with gaps.
"""

from __future__ import annotations

import numpy as np

#: The sum of autocorrelations ends at this many correlation times (Sokal's window).
_AUTOCORRELATION_WINDOW = 4.0
#: The sum also ends at the lag at which fewer than this fraction of the samples has a partner.
_MIN_PAIRED_SHARE = 0.5


def compute_variance_inflation(residual: np.ndarray, is_run_start: np.ndarray) -> float:
    """Return the factor s T on variances for a whitened residual, at least one.

    Args:
        residual: (n,) whitened residuals, in the order of time within each run.
        is_run_start: (n,) whether a run begins at this residual.
    """
    if not residual.size:
        return 1.0
    return max(float(np.mean(residual**2)) * estimate_autocorrelation_time(residual, is_run_start), 1.0)


def estimate_autocorrelation_time(
    residual: np.ndarray, is_run_start: np.ndarray, effective_parameters: float = 0.0
) -> float:
    """Return the integrated autocorrelation time 1 + 2 Σ ρ_k, samples.

    Each fitted parameter reduces the autocovariance of n residuals by Γ/n at every lag, where Γ is the sum of
    the autocovariance. In a window of 2W + 1 lags, the sum is too small by the fraction (2W + 1)/n for each
    parameter. The result is corrected for this bias.

    Source: for a mean, Wolff, Comput. Phys. Commun. 156, 143 (2004).

    Args:
        residual: (n,) residuals over their standard deviation, in the order of time; NaN where not measured.
        is_run_start: (n,) whether a continuous run begins at this row.
        effective_parameters: number of parameters that the fit has estimated from these samples.
    """
    runs = [run[np.isfinite(run)] for run in np.split(residual, np.flatnonzero(is_run_start)[1:])]
    runs = [run for run in runs if run.size > 1]
    n = sum(run.size for run in runs)
    if n < 30:
        return 1.0
    covariance = _pool_autocovariance(runs)
    if covariance[0] <= 0:
        return 1.0
    total = 2 * np.cumsum(covariance / covariance[0]) - 1
    long_enough = np.flatnonzero(np.arange(total.size) >= _AUTOCORRELATION_WINDOW * np.maximum(total, 1) / 2)
    window = int(long_enough[0]) if long_enough.size else total.size - 1
    # This is the first order of a series: at most a factor of two. The result is between one and n.
    correction = min(effective_parameters * (2 * window + 1) / n, 1.0)
    return float(np.clip(total[window] * (1 + correction), 1.0, n))


def _pool_autocovariance(runs: list[np.ndarray]) -> np.ndarray:
    """Return the autocovariance at lags with enough pairs, pooled over runs, without pairs across gaps."""
    longest = max(run.size for run in runs)
    size = 1 << (2 * longest - 1).bit_length()
    total, count = np.zeros(longest), np.zeros(longest)
    for run in runs:
        spectrum = np.abs(np.fft.rfft(run, size)) ** 2
        total[: run.size] += np.fft.irfft(spectrum, size)[: run.size]
        count[: run.size] += run.size - np.arange(run.size)
    has_pairs = count >= _MIN_PAIRED_SHARE * count[0]
    return total[has_pairs] / count[has_pairs]
