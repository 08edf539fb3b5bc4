"""Noise of one channel that partly repeats itself, and the filter that makes it white.

A channel's noise is taken as its sensor's, which may repeat itself from sample to sample,

    cov(s_t, s_t+k) = A ρ^k,        k >= 1,        of the standardised residual s,

on top of what pressure's and length's noise carry through the model, which does not: W = 1 − A. The Kalman
filter of that process is

    e_1 = s_1,    e_t+1 = s_t+1 − ρ s_t + ρ (1 − K_t) e_t,    K_t = p_t / (p_t + W),
    p_1 = A,      p_t+1 = ρ² p_t W / (p_t + W) + A (1 − ρ²),

and e_t / √(p_t + W) is white. K soon is steady; until then a run is filtered by a matrix.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.signal import lfilter

from pamjax.infer.noise.unknown_sensor import Unstated

#: How far back the memory of noise is followed, samples.
BACK = 400

#: Share of the way from A to the steady p that is left where a filter counts as steady.
STEADY = 1e-3


@dataclass(frozen=True)
class Colour:
    """Noise of one channel.

    Attributes:
        sd: (n,) effective standard deviation of each sample, SI.
        shared: A, the share of the variance that repeats itself.
        correlation: ρ, of neighbouring samples of that share.
        given: whether the sensor's noise was stated.
        freedom: how many independent squares tell the noise; infinite where it was stated.
        told: ρ as neighbours' differences tell it, whether it counts as seen or not.
        might: what size and memory might be, of a sensor of which nothing was stated.
    """

    sd: np.ndarray
    shared: float
    correlation: float
    given: bool
    freedom: float = math.inf
    told: float = 0.0
    might: Unstated | None = None

    @property
    def filter(self) -> tuple[float, float]:
        """θ of the steady moving average, and the standard deviation √S of what is left of a unit sample."""
        return _steady(self.shared, self.correlation)

    def whitened(self, run: np.ndarray) -> np.ndarray:
        """A run of standardised samples, (…, m), filtered: white, of unit variance."""
        rho = self.correlation
        if rho == 0 or self.shared == 0:
            return run
        theta, left = self.filter
        begin = _begin(self.shared, rho)
        m = min(len(begin.sd), run.shape[-1])
        first = run[..., :m] @ begin.filter[:m, :m].T
        if m == run.shape[-1]:
            return first
        last = -rho * run[..., m - 1] + theta * begin.sd[-1] * first[..., m - 1]
        rest, _ = lfilter([1.0, -rho], [1.0, -theta], run[..., m:], axis=-1, zi=last[..., None])
        return np.concatenate([first, np.asarray(rest) / left], axis=-1)

    def log_sd(self, samples: int) -> float:
        """Sum over a run of the logarithms of what each is divided by."""
        if self.correlation == 0 or self.shared == 0:
            return 0.0
        begun = np.log(_begin(self.shared, self.correlation).sd[:samples])
        return float(begun.sum()) + (samples - begun.size) * math.log(self.filter[1])


@dataclass(frozen=True, eq=False)
class _Begin:
    """The filter of a run's first samples.

    Attributes:
        filter: (m, m) lower triangular, from samples to white ones.
        sd: (m,) √(p_t + W), by which innovations were divided.
    """

    filter: np.ndarray
    sd: np.ndarray


@lru_cache(maxsize=256)
def _steady(shared: float, rho: float) -> tuple[float, float]:
    white = 1 - shared
    if rho == 0 or shared == 0:
        return rho, 1.0
    push = shared * (1 - rho**2)
    # Steady Riccati equation p = ρ² p W / (p + W) + push, a quadratic.
    b = white * (1 - rho**2) - push
    p = (-b + math.sqrt(b * b + 4 * push * white)) / 2
    return rho * white / (p + white), math.sqrt(p + white)


@lru_cache(maxsize=64)
def _begin(shared: float, rho: float) -> _Begin:
    white, p = 1 - shared, shared
    steady = _steady(shared, rho)[1] ** 2 - white
    rows, sd = [np.ones(1)], [1.0]
    while abs(p - steady) > STEADY * max(shared - steady, 1e-9) and len(sd) < BACK:
        # The innovation as a sum over the samples up to it.
        again = rho * white / (p + white)
        row = np.append(again * rows[-1], 1.0)
        row[-2] -= rho
        rows.append(row)
        p = rho**2 * p * white / (p + white) + shared * (1 - rho**2)
        sd.append(math.sqrt(p + white))
    matrix = np.zeros((len(sd), len(sd)))
    for t, row in enumerate(rows):
        matrix[t, : t + 1] = row / sd[t]
    return _Begin(matrix, np.array(sd))


def correlation_error(shared: float, correlation: float, samples: int) -> float:
    """Standard error of ρ as neighbours' differences tell it, with A known.

    Half the mean square of n differences with autocovariances r_k has the variance Σ r_k² / 2n, over all k.
    """
    noise = shared * correlation ** np.arange(BACK + 2)
    noise[0] = 1.0
    steps = 2 * noise[:-1] - np.r_[noise[1], noise[:-2]] - noise[1:]
    return math.sqrt((steps[0] ** 2 + 2 * float(np.sum(steps[1:] ** 2))) / (2 * samples)) / shared
