"""Most likely size of form errors, against the likelihood of a dense covariance."""

from types import SimpleNamespace

import numpy as np
import pytest

from pamjax.diagnosis.form_errors.fit import build_form_cost, estimate_form_shares
from pamjax.diagnosis.refit import least_squares
from pamjax.diagnosis.settings import DEFAULT_SETTINGS
from pamjax.infer.form_errors.shares import RELATIVE_SHARES
from tests.agreement import SOLVED, agree

N = 80
FREE = (0, 1)
PRIOR_MEAN, PRIOR_SD = np.array([0.3, -0.2]), np.array([0.5, 2.0])


@pytest.fixture
def problem(monkeypatch):
    """Return a problem of two parameters with Gaussian priors, in their own coordinates."""
    monkeypatch.setattr(
        "pamjax.diagnosis.form_errors.fit.compute_priors", lambda problem, free: (PRIOR_MEAN, PRIOR_SD)
    )
    return SimpleNamespace(
        is_logarithmic=np.zeros(2, dtype=bool),
        low=np.full(2, -9.0),
        high=np.full(2, 9.0),
        settings=DEFAULT_SETTINGS,
    )


def build_estimate(residual, jacobian, values):
    return least_squares.MapEstimate(
        FREE, values, 0.0, 0.0, residual, lambda: jacobian, prior_sd=PRIOR_SD, scale=np.ones(2)
    )


def draw_columns(rng):
    """Return a Jacobian, (N, 2), and two form errors, (3, N) and (2, N)."""
    return rng.standard_normal((N, 2)), [rng.standard_normal((3, N)), 2 * rng.standard_normal((2, N))]


def compute_dense_cost(residual, jacobian, values, forms, shares):
    """Return −2 ln L of the residual, with the parameters and the form errors integrated out."""
    form_covariance = np.eye(N) + sum(s**2 * f.T @ f for s, f in zip(shares, forms, strict=True))
    covariance = form_covariance + jacobian @ np.diag(PRIOR_SD**2) @ jacobian.T
    # The residual at the prior mean of the parameters.
    at_mean = residual + jacobian @ (values - PRIOR_MEAN)
    return at_mean @ np.linalg.solve(covariance, at_mean) + np.linalg.slogdet(form_covariance)[1]


@pytest.mark.parametrize("shares", [(0.0, 0.0), (0.1, 0.0), (0.3, 0.03)])
def test_cost_is_the_likelihood_of_a_dense_covariance(problem, shares):
    rng = np.random.default_rng(3)
    jacobian, forms = draw_columns(rng)
    residual, values = 2 * rng.standard_normal(N), np.array([0.7, 0.4])
    cost = build_form_cost(problem, build_estimate(residual, jacobian, values), forms)
    none = (0.0, 0.0)
    difference = cost.evaluate(shares) - cost.evaluate(none)
    expected = compute_dense_cost(residual, jacobian, values, forms, shares) - compute_dense_cost(
        residual, jacobian, values, forms, none
    )
    agree(difference, expected, SOLVED, N)
    if any(shares):
        # Without the determinant, the cost would always decrease.
        assert abs(difference) > 1e-3


@pytest.mark.parametrize("true_share", RELATIVE_SHARES)
def test_the_true_share_is_the_most_likely_one(problem, true_share):
    rng = np.random.default_rng(5)
    jacobian, forms = draw_columns(rng)
    share = true_share * DEFAULT_SETTINGS.max_form_share
    # Columns of 30 sd: their coefficients determine the share to some 30 %.
    form = np.repeat(30 * forms[0], 4, axis=0) + 30 * rng.standard_normal((12, N))
    residual = rng.standard_normal(N) + share * rng.standard_normal(12) @ form
    estimate = build_estimate(residual, 1e-9 * jacobian, PRIOR_MEAN)
    (estimated,) = estimate_form_shares(problem, estimate, [form])
    assert estimated == pytest.approx(share)


@pytest.mark.parametrize("value", [0.4, 9.0])
def test_parameter_at_its_limit_does_not_replace_a_form_error(problem, value):
    """The residual is a form error that the derivative by the second parameter resembles."""
    rng = np.random.default_rng(6)
    form = rng.standard_normal((1, N))
    jacobian = np.stack([rng.standard_normal(N), form[0]], axis=1)
    residual = rng.standard_normal(N) + 10 * form[0]
    values = np.array([PRIOR_MEAN[0], value])
    estimate = build_estimate(residual, 1e3 * jacobian, values)
    (share,) = estimate_form_shares(problem, estimate, [100 * form])
    assert (share > 0) == (value == 9.0)
