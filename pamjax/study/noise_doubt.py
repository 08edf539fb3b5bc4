"""How well the noise along a direction is known: its correlation was read off the recording itself.

A direction d, white and of unit length, has the noise variance

    V(ρ′) = Σ_ω |d(ω)|² S(ω; ρ′) / S(ω; ρ),     S(ω; ρ) = 1 − A + A (1 − ρ²) / |1 − ρ e^(−iω)|²,

if the correlation is ρ′ where it was taken for ρ: a slow direction has more for a larger one, a fast one
less. The doubt is half the logarithm of V one standard error of ρ away, its size alone; a channel in which no
correlation was looked for has that of so many squares. What it leaves out: that runs end, and a sensor that
is worse than stated.
Source: filtering of a stationary process, derived here.
"""

from __future__ import annotations

import math

import numpy as np

from pamjax.study.whiten import FEW, MOST, Colour, Whitening, correlation_error


def doubts(white: Whitening, directions: np.ndarray) -> np.ndarray:
    """Relative doubt about the noise of each direction, by channel.

    Args:
        white: the noise.
        directions: (k, size or more) white directions; what is beyond the samples is priors.

    Returns:
        (k, channels) change of ln(standard deviation) for a standard error of a channel's noise.
    """
    out, begin = np.zeros((len(directions), len(white.colours))), 0
    for c, (colour, rows) in enumerate(zip(white.colours, white.rows, strict=True)):
        part = directions[:, begin : begin + rows.size]
        begin += rows.size
        if colour is not None and rows.size > 1 and math.isinf(colour.freedom):
            out[:, c] = _doubt(colour, part)
    return out


def _doubt(colour: Colour, part: np.ndarray) -> np.ndarray:
    """Of one channel, weighted by its share of each direction, (k,)."""
    samples = part.shape[1]
    share = np.sum(part**2, axis=1)
    if not colour.given or samples < FEW:
        return share * 0.5 * math.sqrt(2 / samples)
    error = correlation_error(colour.shared, colour.correlation, samples)
    power = np.abs(np.fft.fft(part, axis=1)) ** 2 / samples
    there = np.exp(-2j * np.pi * np.arange(samples) / samples)
    more = min(colour.correlation + error, MOST)
    ratio = _density(colour.shared, more, there) / _density(colour.shared, colour.correlation, there)
    along = 0.5 * np.log(
        power @ ratio / np.maximum(share, 1e-300), where=share > 1e-12, out=np.zeros_like(share)
    )
    return share * np.abs(along)


def _density(shared: float, correlation: float, there: np.ndarray) -> np.ndarray:
    """Spectrum of noise of unit variance at e^(−iω)."""
    return 1 - shared + shared * (1 - correlation**2) / np.abs(1 - correlation * there) ** 2
