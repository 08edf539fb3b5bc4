"""The noise of a sensor of which nothing was stated: its size and its memory, from the recording alone.

Second differences at a lag of m samples know little of what is smooth, and of noise that repeats itself,
cov(s_t, s_t+k) = A ρ^k, they have the mean square

    E (s_t+m − 2 s_t + s_t−m)² = A (6 − 8 ρ^m + 2 ρ^2m) + c m⁴,

c m⁴ of a misfit that bends. Several lags tell A, ρ and c apart, with an error that follows from ρ itself. ρ
may be zero, half a chance before anything was seen, or any of the others in `TRIED`. What it leaves out:
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
LAGS = np.array([1, 2, 4, 8, 16])
#: Correlations of neighbours that are tried: none, and what lies between.
TRIED = np.concatenate([[0.0], np.linspace(0.02, 0.98, 49)])
#: Ranks at which a variance is looked at.
RANKS = (np.arange(12) + 0.5) / 12
#: How far apart differences may be and still share noise, samples.
APART = 300


@dataclass(frozen=True, eq=False)
class Seen:
    """Mean squares of second differences at each of `LAGS`.

    Attributes:
        squares: of the residual, SI squared.
        counts: how many differences there are.
        white: what stated noise of pressure and length is expected to add.
        known: share to which that is known.
        open: whether there may be more white noise, of which nothing was stated.
    """

    squares: np.ndarray
    counts: np.ndarray
    white: np.ndarray
    known: float
    open: bool = False


@dataclass(frozen=True, eq=False)
class Unstated:
    """What a recording tells of a sensor's noise.

    Attributes:
        taken: correlation and variance (SI squared) that it is taken to have.
        white: variance of other white noise, of which nothing was stated, SI squared.
        might: (k, 2) what correlation and variance might be, from the least slow noise to the most.
        chance: (k,) of each.
    """

    taken: tuple[float, float]
    white: float
    might: np.ndarray
    chance: np.ndarray


def unstated(seen: Seen) -> Unstated:
    """Size and memory of noise from mean squares of second differences."""
    # Where a recording is all but free of noise: next to nothing beside what was stated.
    floor = np.maximum(1e-6 * seen.white, 1e-36)
    seen = replace(seen, squares=np.maximum(seen.squares, floor))
    likely, variance, error, white = np.array([_fitted(k, seen) for k in range(TRIED.size)]).T
    prior = np.r_[0.5, np.full(TRIED.size - 1, 0.5 / (TRIED.size - 1))]
    chance = prior * np.exp(likely - likely.max())
    chance /= chance.sum()
    # A variance is known with its error, and is not negative.
    low = -variance / error
    sizes = variance[:, None] + error[:, None] * truncnorm.ppf(RANKS, low[:, None], np.inf)
    might = np.stack(np.broadcast_arrays(TRIED[:, None], sizes), axis=-1).reshape(-1, 2)
    slow = np.argsort(might[:, 1] * (1 + might[:, 0]) / (1 - might[:, 0]))
    each = np.repeat(chance / RANKS.size, RANKS.size)
    some = float(chance[1:].sum())
    # No correlation, unless some is more probable than none.
    rho = float(chance[1:] @ TRIED[1:]) / some if some > 0.5 else 0.0
    own, other = (float(np.interp(rho, TRIED, values)) for values in (np.maximum(variance, 1e-36), white))
    return Unstated((rho, own), other, might[slow], each[slow])


def _fitted(k: int, seen: Seen) -> tuple[float, float, float, float]:
    """Log-likelihood of one correlation, the variance that goes with it, its error, and other white noise."""
    mean, covariance = _expected(k)
    squares, per = seen.squares, 1 / np.sqrt(seen.counts)
    # All in shares of each square, as it was seen.
    other, bend = seen.white / squares, (LAGS / LAGS[-1]) ** 4 * squares[-1] / squares
    root = np.linalg.cholesky(covariance * np.outer(per, per) + seen.known**2 * np.outer(other, other))
    columns = [mean / squares, bend]
    if seen.open and TRIED[k] > 0:
        columns.append(6 / squares)
    rows = solve_triangular(root, np.stack([*columns, 1 - other], axis=1), lower=True)
    design, wanted = rows[:, :-1], rows[:, -1]
    (variance, *rest), left = nnls(design, wanted)
    beside = design[:, 1:][:, np.array(rest) > 0]
    own = design[:, 0] - beside @ np.linalg.lstsq(beside, design[:, 0])[0]
    free = own @ wanted / (own @ own)
    likely = -0.5 * left**2 - np.log(np.diag(root)).sum()
    return (
        float(likely),
        float(free if variance == 0 else variance),
        float((own @ own) ** -0.5),
        sum(rest[1:]),
    )


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
