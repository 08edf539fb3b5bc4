"""Restricted maximum likelihood estimate of the noise correlation from the whole residual of a model.

A slow residual can be misfit, so the first noise estimate uses only differences of neighbours. If input noise
dominates these differences, they determine the correlation badly. The residual of a model without systematic
misfit is noise at all frequencies. The correlations ρ of both channels then minimise, with the parameters x
of the model integrated out:

    −2 ln L(ρ) = |e|² + |(x − m)/s|² − bᵀ A⁻¹ b + ln det C(ρ) + ln det A,
    e = W(ρ) r,   J = W(ρ) ∂f/∂x,   A = JᵀJ + Λ,   b = Jᵀe − Λ (x − m),   Λ = diag 1/s²,

r the residual, W the whitening filter, m and s the mean and sd of the priors. The last term corrects for slow
noise that the parameters absorb; without it ρ is underestimated.
Neglects: a sensor without stated noise; the noise level, which stays that of neighbouring samples.
Source: restricted likelihood, H. D. Patterson, R. Thompson, Biometrika 58, 545 (1971), linear in x.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.optimize import minimize_scalar

from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.least_squares import compute_priors, fit_parameters, transform_to_coordinates
from pamjax.diagnosis.refit.model_fit import ModelFit, build_corrected_fit
from pamjax.infer.noise.noise_model import NoiseModel
from pamjax.infer.problem.unit_diagonal import scale_to_unit_diagonal

#: Starting grid of the search for the most likely correlation; the largest allowed one is added.
_TRIAL_CORRELATIONS = (0.0, 0.2, 0.4, 0.6, 0.75, 0.85, 0.92, 0.96)


def fit_noise_correlation(problem: LibraryProblem, fit: ModelFit) -> ModelFit:
    """Return the fit, refitted with the noise correlations estimated from its whole residual.

    Args:
        problem: the recording and the library.
        fit: the fit; unchanged if it has systematic misfit or no sensor's noise is stated.
    """
    if fit.noise.weight != 1:
        return fit
    compute_deviance, noise = _build_restricted_deviance(problem, fit), fit.noise
    for _ in range(problem.settings.correlation_sweeps):
        for c, channel in enumerate(noise.by_channel):
            if channel is not None and channel.is_stated and not channel.degrees_of_freedom < np.inf:
                noise = (
                    _fit_channel_correlation(
                        noise, c, compute_deviance, problem.settings.max_noise_correlation
                    )
                    if noise.rows[c].size >= problem.settings.min_samples_for_correlation
                    else noise
                )
    if not _has_correlation_changed(fit.noise, noise, problem.settings.min_correlation_change):
        return fit
    return build_corrected_fit(
        problem, fit.mechanisms, noise, fit_parameters(problem, noise, fit.estimate.free, fit.estimate.values)
    )


def _build_restricted_deviance(problem: LibraryProblem, fit: ModelFit) -> Callable[[NoiseModel], float]:
    """Return the function −2 ln L of a noise model, without a constant."""
    estimate, free = fit.estimate, list(fit.estimate.free)
    prediction, model_jacobian = problem.predict_with_jacobian(estimate.values, free)
    residual, model_jacobian = problem.measured - prediction, model_jacobian * estimate.scale[:, None, None]
    precision = 1 / estimate.prior_sd**2
    prior_gradient = (
        transform_to_coordinates(problem, free, estimate.values) - compute_priors(problem, free)[0]
    ) * precision

    def compute_deviance(noise: NoiseModel) -> float:
        e, jacobian = np.nan_to_num(noise.whiten(residual)), np.nan_to_num(noise.whiten(model_jacobian))
        information = jacobian @ jacobian.T + np.diag(precision)
        scaled_information, unit = scale_to_unit_diagonal(information)
        value, vector = np.linalg.eigh(scaled_information)
        value = np.maximum(value, 1e-12)
        absorbed_part = vector.T @ ((jacobian @ e - prior_gradient) / unit)
        determinant = float(np.sum(np.log(value)) + 2 * np.sum(np.log(unit)))
        return float(e @ e - np.sum(absorbed_part**2 / value)) + noise.log_determinant + determinant

    return compute_deviance


def _fit_channel_correlation(
    noise: NoiseModel, c: int, compute_deviance: Callable[[NoiseModel], float], max_correlation: float
) -> NoiseModel:
    """Return the noise model with the most likely correlation of one channel."""

    def set_correlation(rho: float) -> NoiseModel:
        channel = noise.by_channel[c]
        assert channel is not None
        by_channel = list(noise.by_channel)
        by_channel[c] = replace(channel, correlation=float(rho), rho_from_differences=float(rho))
        return replace(noise, by_channel=tuple(by_channel))

    trials = [rho for rho in _TRIAL_CORRELATIONS if rho < max_correlation] + [max_correlation]
    k = int(np.argmin([compute_deviance(set_correlation(rho)) for rho in trials]))
    interval = trials[max(k - 1, 0)], trials[min(k + 1, len(trials) - 1)]
    solution = minimize_scalar(
        lambda rho: compute_deviance(set_correlation(rho)), bounds=interval, method="bounded"
    )
    return set_correlation(
        solution.x if solution.fun < compute_deviance(set_correlation(trials[k])) else trials[k]
    )


def _has_correlation_changed(before: NoiseModel, after: NoiseModel, min_change: float) -> bool:
    return any(
        a is not None and b is not None and abs(a.correlation - b.correlation) > min_change
        for a, b in zip(before.by_channel, after.by_channel, strict=True)
    )
