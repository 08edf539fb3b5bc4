"""Weigh a recording by what its model cannot say, so that what the lab measured still counts.

A model that leaves more than noise is wrong by something smooth. Weighed by noise alone, thousands of rows
that repeat one mistake overrule every ruler: a muscle grows by millimetres to please a wall law that is not
quite right. So the whitened residual r of such a model is scaled by a trust

    τ = 1 / √(s T),     s = mean r²,     T = 1 + 2 Σ ρ_k,

with T the samples over which r repeats itself (Geyer's initial positive sequence), and the model is refitted:
its rows then count as what n / T independent samples of its own misfit do. Where s is near one nothing
changes. What it leaves out: a misfit that differs between parts of a recording.
Source: the widening of least squares by its own misfit, with the effective sample size of C. Geyer,
Statist. Sci. 7, 473 (1992).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from pamjax.diagnosis.library.candidates import Form
from pamjax.diagnosis.library.library_problem import Problem
from pamjax.diagnosis.noise.estimate import whitening
from pamjax.diagnosis.refit.candidate_fit import Model, moving, settle
from pamjax.diagnosis.refit.least_squares import refit

#: Mean square of a whitened residual from which a model is taken for wrong by more than noise.
WRONG = 1.5

#: A refit changes the misfit that it was weighed by: weighed so many times.
ROUNDS = 2


def weighed(found: Problem, used: np.ndarray, chosen: Sequence[Form], values: np.ndarray) -> Model:
    """Refit the baseline with some forms, its rows weighed by what is left where it begins.

    Settled under the recording's noise first, a model that is wrong runs to wherever thousands of rows bend
    it, and may not find back from there.

    Args:
        found: the recording before the library.
        used: (n,) the rows that tell.
        chosen: the forms.
        values: (p,) where everything begins, SI.
    """
    white = whitening(found, values, used)
    residual = np.nan_to_num(white(found.measured - found.shows(values)), nan=1e3)
    if _square(residual) < WRONG:
        return settle(found, used, chosen, values)
    white = dataclasses.replace(white, trust=_trust(residual))
    moved = moving(found, chosen)
    model = tempered(found, Model(tuple(chosen), white, refit(found, white, moved, values)))
    if _square(model.at.residual / model.white.trust) < WRONG:
        # It was wrong only where it began.
        return settle(found, used, chosen, model.at.values)
    return model


def tempered(found: Problem, model: Model) -> Model:
    """The model, refitted with its rows weighed by its own misfit; as it is where that is noise.

    Args:
        found: the recording before the library.
        model: refitted under the recording's noise.
    """
    for _ in range(ROUNDS):
        residual = model.at.residual / model.white.trust
        if _square(residual) < WRONG:
            return model
        white = dataclasses.replace(model.white, trust=_trust(residual))
        model = Model(model.chosen, white, refit(found, white, model.at.moved, model.at.values))
    return model


def _square(residual: np.ndarray) -> float:
    return float(np.mean(residual**2)) if residual.size else 1.0


def _trust(residual: np.ndarray) -> float:
    return float(1 / np.sqrt(_square(residual) * repeats(residual)))


def repeats(residual: np.ndarray) -> float:
    """Over how many samples a residual repeats itself, 1 for white noise.

    >>> 0.8 < repeats(np.random.default_rng(0).standard_normal(2000)) < 1.2
    True
    """
    centred = residual - residual.mean()
    spectrum = np.fft.rfft(centred, 2 * centred.size)
    lags = np.fft.irfft(spectrum * np.conj(spectrum))[: centred.size]
    if lags[0] <= 0 or lags.size < 4:
        return 1.0
    pairs = (lags[:-1:2] + lags[1::2])[: lags.size // 2] / lags[0]
    ends = np.flatnonzero(pairs <= 0)
    return float(max(2 * pairs[: ends[0] if ends.size else None].sum() - 1, 1.0))
