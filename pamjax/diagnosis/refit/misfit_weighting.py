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

from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.noise.estimate import estimate_noise
from pamjax.diagnosis.refit.candidate_fit import CandidateFit, fit_candidate, get_free_indices
from pamjax.diagnosis.refit.least_squares import fit_parameters

#: Mean square of a whitened residual from which a model is taken for wrong by more than noise.
MIN_MISFIT_MEAN_SQUARE = 1.5

#: A refit changes the misfit that it was weighed by: weighed so many times.
MISFIT_WEIGHTING_ROUNDS = 2


def fit_with_misfit_weight(
    problem: LibraryProblem, training_rows: np.ndarray, mechanisms: Sequence[Candidate], values: np.ndarray
) -> CandidateFit:
    """Refit the baseline with some forms, its rows weighed by what is left where it begins.

    Settled under the recording's noise first, a model that is wrong runs to wherever thousands of rows bend
    it, and may not find back from there.

    Args:
        problem: the recording before the library.
        training_rows: (n,) the rows that tell.
        mechanisms: the forms.
        values: (p,) where everything begins, SI.
    """
    noise = estimate_noise(problem, values, training_rows)
    residual = np.nan_to_num(noise.whiten(problem.measured - problem.predict(values)), nan=1e3)
    if _compute_mean_square(residual) < MIN_MISFIT_MEAN_SQUARE:
        return fit_candidate(problem, training_rows, mechanisms, values)
    noise = dataclasses.replace(noise, weight=_compute_weight(residual))
    free = get_free_indices(problem, mechanisms)
    fit = reweight_by_misfit(
        problem, CandidateFit(tuple(mechanisms), noise, fit_parameters(problem, noise, free, values))
    )
    if _compute_mean_square(fit.estimate.residual / fit.noise.weight) < MIN_MISFIT_MEAN_SQUARE:
        # It was wrong only where it began.
        return fit_candidate(problem, training_rows, mechanisms, fit.estimate.values)
    return fit


def reweight_by_misfit(problem: LibraryProblem, fit: CandidateFit) -> CandidateFit:
    """The model, refitted with its rows weighed by its own misfit; as it is where that is noise.

    Args:
        problem: the recording before the library.
        fit: refitted under the recording's noise.
    """
    for _ in range(MISFIT_WEIGHTING_ROUNDS):
        residual = fit.estimate.residual / fit.noise.weight
        if _compute_mean_square(residual) < MIN_MISFIT_MEAN_SQUARE:
            return fit
        noise = dataclasses.replace(fit.noise, weight=_compute_weight(residual))
        fit = CandidateFit(
            fit.mechanisms, noise, fit_parameters(problem, noise, fit.estimate.free, fit.estimate.values)
        )
    return fit


def _compute_mean_square(residual: np.ndarray) -> float:
    return float(np.mean(residual**2)) if residual.size else 1.0


def _compute_weight(residual: np.ndarray) -> float:
    return float(
        1 / np.sqrt(_compute_mean_square(residual) * compute_integrated_autocorrelation_time(residual))
    )


def compute_integrated_autocorrelation_time(residual: np.ndarray) -> float:
    """Over how many samples a residual repeats itself, 1 for white noise.

    >>> 0.8 < compute_integrated_autocorrelation_time(np.random.default_rng(0).standard_normal(2000)) < 1.2
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
