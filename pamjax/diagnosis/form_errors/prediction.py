"""Prediction of a model with its uncertainty, and the part of each mechanism's form error in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pamjax.diagnosis.form_errors.columns import compute_effect
from pamjax.diagnosis.form_errors.fit import FormErrorFit
from pamjax.diagnosis.library.library_problem import LibraryProblem
from pamjax.diagnosis.refit.model_fit import ModelFit
from pamjax.infer.form_errors.discrepancy import DiscrepancyNoise
from pamjax.infer.form_errors.parts import FormErrorPart, build_form_part, compute_prediction_sd
from pamjax.infer.noise.autocorrelation import compute_variance_inflation
from pamjax.infer.noise.noise_model import NoiseModel


@dataclass(frozen=True, eq=False)
class ModelPrediction:
    """Prediction of a fit, with its form errors if it has any.

    Attributes:
        values: (2, n) predicted force (N) and diameter (m).
        sd: (2, n) its standard deviation due to parameters and form errors.
        has_form_errors: whether the most likely size of a form error is above zero.
    """

    values: np.ndarray
    sd: np.ndarray
    has_form_errors: bool


def describe_form_errors(problem: LibraryProblem, fit: ModelFit) -> dict[str, FormErrorPart]:
    """Return the form error of each mechanism that has one; empty for a fit without form errors."""
    if not isinstance(fit, FormErrorFit):
        return {}
    noise, values, parts = fit.noise, fit.estimate.values, {}
    assert isinstance(noise, DiscrepancyNoise)
    residual, is_measured = problem.measured - problem.predict(values), np.isfinite(problem.measured)
    for candidate in fit.mechanisms:
        if candidate.id in fit.shares:
            form = noise.estimate_discrepancy(residual, candidate.id)
            effect = compute_effect(problem, values, candidate)
            form_white, effect_white = (_whiten(noise, part) for part in (form, effect))
            parts[candidate.id] = build_form_part(
                fit.shares[candidate.id], form, effect, form_white, effect_white, np.asarray(is_measured)
            )
    return parts


def predict_with_uncertainty(problem: LibraryProblem, fit: ModelFit) -> ModelPrediction:
    """Return the prediction of a fit and its standard deviation, with the estimated form errors.

    Args:
        problem: the recording and the library.
        fit: a fit, with form errors or without.
    """
    noise, estimate = fit.noise, fit.estimate
    prediction, derivatives = problem.predict_with_jacobian(estimate.values, estimate.free)
    has_form_errors = isinstance(noise, DiscrepancyNoise) and bool(noise.columns.any())
    sd = compute_prediction_sd(*compute_joint_whitening(fit, derivatives))
    if isinstance(noise, DiscrepancyNoise):
        prediction = prediction + noise.estimate_discrepancy(problem.measured - prediction)
    return ModelPrediction(prediction, sd, has_form_errors)


def compute_joint_whitening(
    fit: ModelFit, derivatives: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the derivatives of a prediction by the coordinates of parameters and by coefficients.

    Args:
        fit: a fit, with form errors or without.
        derivatives: (p, 2, n) derivatives by the free parameters, SI.

    Returns:
        the derivatives, (k, 2, n), SI; the same whitened, (k, size); precision of their priors, (k,).
    """
    noise, estimate = fit.noise, fit.estimate
    scaled = np.nan_to_num(derivatives) * estimate.scale[:, None, None]
    forms = noise.columns if isinstance(noise, DiscrepancyNoise) else scaled[:0]
    columns = np.concatenate([scaled, forms])
    inflation = compute_variance_inflation(estimate.residual, noise.is_run_start)
    return (
        columns,
        _whiten(noise, columns) / np.sqrt(inflation),
        np.concatenate([1 / estimate.prior_sd**2, np.ones(len(forms))]),
    )


def _whiten(noise: NoiseModel, values: np.ndarray) -> np.ndarray:
    """Return values whitened by the noise without form errors; zero where not measured."""
    return np.nan_to_num(NoiseModel.whiten(noise, values))
