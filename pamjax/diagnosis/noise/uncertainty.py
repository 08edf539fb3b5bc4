"""How well the noise along a direction is known: its correlation was read off the recording itself.

A direction d, white and of unit length, has the noise variance

    V(ρ′) = Σ_ω |d(ω)|² S(ω; ρ′) / S(ω; ρ),     S(ω; ρ) = 1 − A + A (1 − ρ²) / |1 − ρ e^(−iω)|²,

if the correlation is ρ′ where it was taken for ρ: a slow direction has more for a larger one, a fast one
less. ρ′ may be zero, half a chance before anything was seen, or anything up to `MOST`; what neighbours'
differences tell of it, with their error, weighs that. Where a channel's own noise is a small part of the
whole they tell little, less still because that of pressure and length is known to a share only, and slow
noise may be there unseen. A channel in which no correlation was looked for has the doubt of so many squared
differences; of a sensor of which nothing was stated size and memory are in doubt together (`unstated.py`).
What it leaves out: that runs end, and a sensor that is worse than stated.
Source: filtering of a stationary process, derived here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.stats import norm, truncnorm

from pamjax.diagnosis.noise.estimate import FEW, MOST, SENSOR, Whitening
from pamjax.infer.noise.ar1_filter import Colour, correlation_error
from pamjax.infer.noise.unknown_sensor import Unstated

#: Standard normal variables at which a channel's noise is looked at; between them it is interpolated.
SCALE = np.linspace(-4.0, 4.0, 33)


@dataclass(frozen=True, eq=False)
class Doubt:
    """Variance of directions whose noise is not known, over what it was taken for.

    Attributes:
        sure: (k,) the part of it that is known.
        by_channel: (k, channels, SCALE) the parts by each channel, as a standard normal variable has it.
    """

    sure: np.ndarray
    by_channel: np.ndarray

    def sd(self, normal: np.ndarray) -> np.ndarray:
        """(m, k) standard deviations, for (m, channels) standard normal variables."""
        variance = np.broadcast_to(self.sure, (len(normal), self.sure.size)).copy()
        place = np.interp(normal, SCALE, np.arange(SCALE.size))
        below = np.minimum(place.astype(int), SCALE.size - 2)
        over = place - below
        for c in range(normal.shape[1]):
            by = self.by_channel[:, c]
            variance += (by[:, below[:, c]] * (1 - over[:, c]) + by[:, below[:, c] + 1] * over[:, c]).T
        return np.sqrt(variance)


def doubt_of(white: Whitening, directions: np.ndarray) -> Doubt:
    """What is not known of the noise of each direction.

    Args:
        white: the noise.
        directions: (k, size or more) white directions; what is beyond the samples is priors.
    """
    parts, begin = [], 0
    for colour, rows in zip(white.colours, white.rows, strict=True):
        part = directions[:, begin : begin + rows.size]
        begin += rows.size
        parts.append(_variances(colour, part))
    by_channel = np.stack(parts, axis=1)
    return Doubt(np.sum(directions[:, begin:] ** 2, axis=1), by_channel)


def _variances(colour: Colour | None, part: np.ndarray) -> np.ndarray:
    """Of one channel, (k, SCALE), with its share of each direction as what is expected."""
    samples, share = part.shape[1], np.sum(part**2, axis=1)[:, None]
    # Noise that was found from few squares has its doubt in the tail of Student's variable.
    if colour is None or samples < 2 or math.isfinite(colour.freedom):
        return np.repeat(share, SCALE.size, axis=1)
    counted = np.exp(SCALE * math.sqrt(3 / samples))
    if samples < FEW or not (colour.given or colour.might):
        return share * counted
    power = np.abs(np.fft.fft(part, axis=1)) ** 2 / samples
    there = np.exp(-2j * np.pi * np.arange(samples) / samples)
    taken = _density(colour.shared, colour.correlation, 1.0, there)
    if colour.might:
        rho, times = _unstated(colour.might)
        might = [_density(colour.shared, *one, there) / taken for one in zip(rho, times, strict=True)]
        return power @ np.stack(might, axis=1) * counted
    might = [_density(colour.shared, rho, 1.0, there) / taken for rho in _correlations(colour, samples)]
    return power @ np.stack(might, axis=1)


def _unstated(might: Unstated) -> tuple[np.ndarray, np.ndarray]:
    """Correlation and share of the variance taken, as a standard normal variable has them, (SCALE,) each."""
    k = np.minimum(np.searchsorted(np.cumsum(might.chance), norm.cdf(SCALE)), might.chance.size - 1)
    rho, variance = might.might[k].T
    return rho, variance / might.taken[1]


def _correlations(colour: Colour, samples: int) -> np.ndarray:
    """The correlation as a standard normal variable has it, (SCALE,), by Bayes' rule."""
    told = colour.told
    by_chance = correlation_error(colour.shared, min(max(told, 0.0), MOST), samples)
    # Of what is not the channel's own the variance is known to a share, and the difference passes for ρ.
    error = math.hypot(by_chance, SENSOR * (1 - colour.shared) / colour.shared)
    low, high = -told / error, (MOST - told) / error
    some = float(norm.cdf(high) - norm.cdf(low)) / MOST
    none = float(norm.pdf(told / error)) / error
    none = none / (none + some) if none + some > 0 else float(told < 0)
    rank = np.clip((norm.cdf(SCALE) - none) / max(1 - none, 1e-12), 0.0, 1.0)
    there = truncnorm.ppf(rank, low, high, told, error)
    return np.where(rank > 0, np.clip(there, 0.0, MOST), 0.0)


def _density(shared: float, correlation: float, times: float, there: np.ndarray) -> np.ndarray:
    """Spectrum at e^(−iω) of noise of unit variance, but for a factor on the variance of its shared part."""
    return 1 - shared + times * shared * (1 - correlation**2) / np.abs(1 - correlation * there) ** 2
