"""The noise of a sensor of which nothing was stated: its size and its memory, from the recording alone.

Second differences at a lag of m samples know little of what is smooth, and of noise that repeats itself,
cov(s_t, s_t+k) = A ρ^k, they have the mean square

    E (s_t+m − 2 s_t + s_t−m)² = A (6 − 8 ρ^m + 2 ρ^2m) + c m⁴,

c m⁴ of a misfit that bends. Several lags tell A, ρ and c apart, with an error that follows from ρ itself. ρ
may be zero, half a chance before anything was seen, or any of the others in `TRIED`. What it leaves out:
misfits that bend on the scale of a few samples, and noise with more than one memory.
Source: derived here; covariance of mean squares of a Gaussian process, M. S. Bartlett, Suppl. J. R. Stat.
Soc. 8, 27 (1946).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from scipy.linalg import solve_triangular
from scipy.optimize import nnls
from scipy.stats import truncnorm

#: Lags of the second differences, samples.
LAGS = np.array([1, 2, 4, 8, 16])
#: Correlations of neighbours that are tried: none, and what lies between.
TRIED = np.concatenate([[0.0], np.linspace(0.02, 0.98, 49)])
#: Ranks at which a variance is looked at.
RANKS = (np.arange(12) + 0.5) / 12
#: How far apart differences may be and still share noise, samples.
APART = 300


@dataclass(frozen=True, eq=False)
class Unstated:
    """What a recording tells of a sensor's noise.

    Attributes:
        taken: correlation and variance (SI squared) that it is taken to have.
        might: (k, 2) what they might be, from the least slow noise to the most.
        chance: (k,) of each.
    """

    taken: tuple[float, float]
    might: np.ndarray
    chance: np.ndarray


def unstated(squares: np.ndarray, white: np.ndarray, known: float, samples: int) -> Unstated:
    """Size and memory of noise from mean squares of second differences.

    Args:
        squares: of the residual, one for each of `LAGS`, SI squared.
        white: what other noise is expected to add to each.
        known: share to which that is known.
        samples: how many there are.
    """
    squares = np.maximum(squares, 1e-36)
    fits = [_fitted(k, squares, white, known, samples) for k in range(TRIED.size)]
    likely, variance, error = (np.array(values) for values in zip(*fits, strict=True))
    prior = np.r_[0.5, np.full(TRIED.size - 1, 0.5 / (TRIED.size - 1))]
    chance = prior * np.exp(likely - likely.max())
    chance /= chance.sum()
    # A variance is known with its error, and is not negative.
    low = -variance / error
    sizes = variance[:, None] + error[:, None] * truncnorm.ppf(RANKS, low[:, None], np.inf)
    might = np.stack(np.broadcast_arrays(TRIED[:, None], sizes), axis=-1).reshape(-1, 2)
    slow = np.argsort(might[:, 1] * (1 + might[:, 0]) / (1 - might[:, 0]))
    each = np.repeat(chance / RANKS.size, RANKS.size)
    return Unstated(_taken(chance, np.maximum(variance, 1e-36)), might[slow], each[slow])


def _taken(chance: np.ndarray, variance: np.ndarray) -> tuple[float, float]:
    """No correlation, unless some is more probable than none."""
    some = float(chance[1:].sum())
    rho = float(chance[1:] @ TRIED[1:]) / some if some > 0.5 else 0.0
    return rho, float(np.interp(rho, TRIED, variance))


def _fitted(
    k: int, squares: np.ndarray, white: np.ndarray, known: float, samples: int
) -> tuple[float, float, float]:
    """Log-likelihood of one correlation, the variance that goes with it, and its error."""
    mean, covariance = _expected(k)
    # All in shares of each square, as it was seen.
    other, bend = white / squares, (LAGS / LAGS[-1]) ** 4 * squares[-1] / squares
    root = np.linalg.cholesky(covariance / samples + known**2 * np.outer(other, other))
    rows = solve_triangular(root, np.stack([mean / squares, bend, 1 - other], axis=1), lower=True)
    (variance, bent), left = nnls(rows[:, :2], rows[:, 2])
    own = (
        rows[:, 0]
        if bent == 0
        else rows[:, 0] - rows[:, 1] * (rows[:, 0] @ rows[:, 1]) / (rows[:, 1] @ rows[:, 1])
    )
    free = own @ rows[:, 2] / (own @ own)
    likely = -0.5 * left**2 - np.log(np.diag(root)).sum()
    return float(likely), float(free if variance == 0 else variance), float((own @ own) ** -0.5)


@cache
def _expected(k: int) -> tuple[np.ndarray, np.ndarray]:
    """Mean squares at unit variance, and their relative covariance times samples."""
    rho, taps, places = TRIED[k], np.array([1.0, -2.0, 1.0]), np.array([-1, 0, 1])
    mean = 6 - 8 * rho**LAGS + 2 * rho ** (2 * LAGS)
    apart = np.arange(-APART, APART + 1)
    covariance = np.empty((LAGS.size, LAGS.size))
    for i, m in enumerate(LAGS):
        for j, n in enumerate(LAGS):
            between = apart[:, None, None] + (n * places)[None, None, :] - (m * places)[None, :, None]
            shared = np.einsum("hab,a,b->h", rho ** np.abs(between), taps, taps)
            covariance[i, j] = 2 * np.sum(shared**2) / (mean[i] * mean[j])
    return mean, covariance


def second_differences(values: np.ndarray, runs: np.ndarray) -> list[np.ndarray]:
    """Second differences of (…, n) values at each of `LAGS`, within runs.

    Args:
        values: one after the other.
        runs: (n,) number of each sample's run.
    """
    within = [runs[2 * m :] == runs[: -2 * m] for m in LAGS]
    return [
        (values[..., 2 * m :] - 2 * values[..., m:-m] + values[..., : -2 * m])[..., there]
        for m, there in zip(LAGS, within, strict=True)
    ]
