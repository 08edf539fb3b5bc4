"""Covariance of parameters with form errors, against repeated draws of a linear model."""

import numpy as np

from pamjax.diagnosis.form_errors.fit import FormErrorFit
from pamjax.diagnosis.form_errors.uncertainty import include_form_errors
from pamjax.diagnosis.refit.model_fit import ModelFit
from tests.agreement import ROUNDING, agree
from tests.diagnosis.plain_fits import build_estimate, build_white_noise

N, FORM_SD = 60, 5.0


def fit_linear(matrix, measured, form, kind):
    """Return the least-squares fit of a linear model; `FormErrorFit` whitens the form error."""
    if kind is FormErrorFit:
        covariance = np.eye(N) + FORM_SD**2 * np.outer(form, form)
        whitening = np.linalg.inv(np.linalg.cholesky(covariance))
        matrix, measured = whitening @ matrix, whitening @ measured
    values = np.linalg.lstsq(matrix, measured, rcond=None)[0]
    estimate = build_estimate(
        values, (0, 1), residual=measured - matrix @ values, jacobian=matrix, prior_sd=np.full(2, 1e9)
    )
    return kind((), build_white_noise(N), estimate)


def test_covariance_contains_the_errors_of_the_reported_values():
    rng = np.random.default_rng(2)
    matrix = np.stack([np.ones(N), np.linspace(-1, 1, N)], axis=1)
    form = matrix @ [0.4, 0.2] / 3 + 0.1 * rng.standard_normal(N)
    true = np.array([2.0, -1.0])
    squares, expected, exact = [], [], []
    for _ in range(400):
        measured = matrix @ true + FORM_SD * rng.standard_normal() * form + rng.standard_normal(N)
        fit = fit_linear(matrix, measured, form, ModelFit)
        complete = include_form_errors(fit, fit_linear(matrix, measured, form, FormErrorFit))
        squares.append((fit.estimate.values - true) ** 2)
        expected.append(np.diag(complete.covariance))
        exact.append(np.diag(fit.covariance))
    ratio = np.mean(squares, axis=0) / np.mean(expected, axis=0)
    assert np.all((ratio > 0.8) & (ratio < 1.25)), ratio
    # Negative control: exact equations state errors that are too small.
    assert np.all(np.mean(squares, axis=0) > 1.5 * np.mean(exact, axis=0))


def test_fit_without_form_errors_keeps_its_covariance():
    rng = np.random.default_rng(3)
    matrix = rng.standard_normal((N, 2))
    fit = fit_linear(matrix, rng.standard_normal(N), matrix[:, 0], ModelFit)
    agree(include_form_errors(fit, fit).covariance, fit.covariance, ROUNDING)
