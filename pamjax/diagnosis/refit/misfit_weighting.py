"""Weight on the samples of a model with systematic misfit, so that the stated values keep their weight.

A systematic misfit is smooth, so its samples are not independent. Weighted as independent, thousands of
samples with one common error outweigh the priors and bias the stated dimensions. The whitened residual r of
such a model is therefore scaled by a weight

    τ = 1 / √(s T),     s = mean r²,     T = 1 + 2 Σ ρ_k,

with T the integrated autocorrelation time of r (`infer/noise/autocorrelation.py`). Then the model is
refitted, and its n samples count as n / T independent samples with the variance of the misfit. Nothing
changes if s is near one. Neglects: a misfit that differs between parts of a recording.
Source: least squares with the variance of its residual, and an effective sample size.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.noise.estimate import estimate_noise
from pamjax.diagnosis.refit.least_squares import fit_parameters
from pamjax.diagnosis.refit.model_fit import ModelFit, fit_model, get_free_indices
from pamjax.infer.noise.autocorrelation import estimate_autocorrelation_time
from pamjax.infer.noise.noise_model import NoiseModel


def fit_with_misfit_weight(
    problem: LibraryProblem, training_mask: np.ndarray, mechanisms: Sequence[Candidate], values: np.ndarray
) -> ModelFit:
    """Return the baseline refitted with some candidates, weighted by the misfit at the starting values.

    A model with systematic misfit that is first fitted without the weight can end in another minimum.

    Args:
        problem: the recording and the library.
        training_mask: (n,) whether a row is used in the fit.
        mechanisms: the candidates.
        values: (p,) starting values, SI.
    """
    noise = estimate_noise(problem, values, training_mask, problem.settings.max_noise_ratio)
    residual = np.nan_to_num(noise.whiten(problem.measured - problem.predict(values)), nan=1e3)
    if not _has_misfit(problem, noise, residual):
        return fit_model(problem, training_mask, mechanisms, values)
    noise = dataclasses.replace(noise, weight=_compute_weight(residual, noise.is_run_start))
    free = get_free_indices(problem, mechanisms)
    fit = reweight_by_misfit(
        problem, ModelFit(tuple(mechanisms), noise, fit_parameters(problem, noise, free, values))
    )
    if not _has_misfit(problem, fit.noise, fit.estimate.residual / fit.noise.weight):
        # The misfit was only at the starting values.
        return fit_model(problem, training_mask, mechanisms, fit.estimate.values)
    return fit


def reweight_by_misfit(problem: LibraryProblem, fit: ModelFit) -> ModelFit:
    """Return the fit, refitted with the weight of its misfit; unchanged if the residual is noise.

    Args:
        problem: the recording and the library.
        fit: the fit with the noise of the recording.
    """
    for _ in range(problem.settings.misfit_weighting_rounds):
        residual = fit.estimate.residual / fit.noise.weight
        if not _has_misfit(problem, fit.noise, residual):
            return fit
        noise = dataclasses.replace(fit.noise, weight=_compute_weight(residual, fit.noise.is_run_start))
        fit = ModelFit(
            fit.mechanisms, noise, fit_parameters(problem, noise, fit.estimate.free, fit.estimate.values)
        )
    return fit


def _has_misfit(problem: LibraryProblem, noise: NoiseModel, residual: np.ndarray) -> bool:
    """Return whether the residual of one sample has a mean square above the limit."""
    excess = (_compute_mean_square(residual) - 1) * noise.size / max(noise.sample_count, 1.0)
    return 1 + excess >= problem.settings.min_misfit_mean_square


def _compute_mean_square(residual: np.ndarray) -> float:
    return float(np.mean(residual**2)) if residual.size else 1.0


def _compute_weight(residual: np.ndarray, is_run_start: np.ndarray) -> float:
    return float(
        1 / np.sqrt(_compute_mean_square(residual) * estimate_autocorrelation_time(residual, is_run_start))
    )
