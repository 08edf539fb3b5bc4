"""Correction of the errors-in-variables bias: input noise biases parameters of mechanisms with memory.

A fitted lag is biased towards half a sample, where it averages input noise most. The corrected cost is
C − p, with p the expected χ² due to input noise. Gauss–Newton steps lead from the minimum of C to that of
C − p:

    δ = −(JᵀJ + Λ)⁻¹ (½ ∇C − ½ ∇p),

J the whitened derivatives, Λ the information of the priors. The steps end when C − p hardly decreases.

The remaining bias is counted as uncertainty. It is estimated as the shift of the parameters when the same
noise is added once more, on average over draws (`estimate_input_noise_bias`):

    δ = (JᵀJ + Λ)⁻¹ mean_u [J_uᵀ W (y − f(x + u)) − Jᵀ W (y − f(x))].

Source: derived here; see `compute_input_noise_chi2`. Added noise (SIMEX): J. Cook, L. Stefanski, J. Am.
Stat. Assoc. 89, 1314 (1994).
"""

from __future__ import annotations

import numpy as np

from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.noise.input_noise import (
    build_perturbed_problems,
    compute_input_noise_chi2_and_gradient,
)
from pamjax.diagnosis.refit.least_squares import (
    MapEstimate,
    compute_priors,
    evaluate_estimate,
    transform_to_coordinates,
)
from pamjax.infer.noise.noise_model import NoiseModel


def correct_input_noise_bias(
    problem: LibraryProblem, noise: NoiseModel, estimate: MapEstimate
) -> tuple[MapEstimate, float]:
    """Return the estimate corrected for input noise, and the expected χ² due to input noise there.

    Args:
        problem: the recording and the library.
        noise: noise model of the fit.
        estimate: the estimate before the correction.
    """
    chi2, gradient = compute_input_noise_chi2_and_gradient(
        problem, noise.whiten, estimate.values, estimate.free
    )
    for _ in range(
        problem.settings.max_correction_steps
        if abs(chi2) > problem.settings.min_input_noise_chi2_share * estimate.chi2
        else 0
    ):
        trial = evaluate_estimate(
            problem, noise, estimate.free, _take_correction_step(problem, estimate, gradient)
        )
        trial_chi2, trial_gradient = compute_input_noise_chi2_and_gradient(
            problem, noise.whiten, trial.values, estimate.free
        )
        decrease = (estimate.chi2_with_priors - chi2) - (trial.chi2_with_priors - trial_chi2)
        if decrease <= 0:
            break
        estimate, chi2, gradient = trial, trial_chi2, trial_gradient
        if decrease < problem.settings.min_correction_decrease:
            break
    return estimate, chi2


def estimate_input_noise_bias(
    problem: LibraryProblem, noise: NoiseModel, estimate: MapEstimate
) -> np.ndarray:
    """Return the shift of the free parameters when input noise is added once more, SI, (k,).

    Args:
        problem: the recording and the library.
        noise: noise model of the fit.
        estimate: the estimate.
    """
    free = list(estimate.free)
    perturbed_problems = build_perturbed_problems(problem, estimate.values)
    if not perturbed_problems:
        return np.zeros(len(free))
    gradient = -estimate.jacobian.T @ estimate.residual
    for perturbed_problem in perturbed_problems:
        prediction, model_jacobian = perturbed_problem.predict_with_jacobian(estimate.values, free)
        jacobian = np.nan_to_num(noise.whiten(model_jacobian)) * estimate.scale[:, None]
        gradient += (
            jacobian @ np.nan_to_num(noise.whiten(problem.measured - prediction)) / len(perturbed_problems)
        )
    return estimate.covariance @ (gradient / estimate.scale)


def _take_correction_step(
    problem: LibraryProblem, estimate: MapEstimate, input_noise_gradient: np.ndarray
) -> np.ndarray:
    """Return parameter values after one Gauss–Newton step, within their limits."""
    free = list(estimate.free)
    x, (mean, _) = transform_to_coordinates(problem, free, estimate.values), compute_priors(problem, free)
    noise_gradient = 0.5 * estimate.scale * input_noise_gradient
    downhill = estimate.jacobian.T @ estimate.residual - (x - mean) / estimate.prior_sd**2 + noise_gradient
    covariance = estimate.covariance / np.outer(estimate.scale, estimate.scale)
    low, high = (transform_to_coordinates(problem, free, edge) for edge in (problem.low, problem.high))
    x = np.clip(x + covariance @ downhill, low, high)
    out, log = estimate.values.copy(), problem.is_logarithmic[free]
    out[free] = np.where(log, np.exp(np.where(log, x, 0.0)), x)
    return out
