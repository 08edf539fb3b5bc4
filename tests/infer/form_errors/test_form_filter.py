"""Filter, estimate and uncertainty of form errors, against dense covariances."""

import numpy as np
import pytest

from pamjax.infer.form_errors.parts import compute_prediction_sd
from pamjax.infer.form_errors.shares import FormCost, choose_shares
from pamjax.infer.problem.form_filter import FormFilter
from tests.agreement import SOLVED, agree

ROWS, COUNT = 30, 3
SIZE = 2 * ROWS


@pytest.fixture
def columns():
    """Return three form errors of white unit noise, (3, 2, ROWS); the last one has size zero."""
    size = np.array([3.0, 0.5, 0.0])[:, None, None]
    return size * np.random.default_rng(1).standard_normal((COUNT, 2, ROWS))


def build_filter(columns):
    return FormFilter.from_columns(columns, columns.reshape(COUNT, SIZE), ("first", "second", "third"))


def test_filter_whitens_the_covariance(columns):
    form_filter = build_filter(columns)
    whiten = np.stack([form_filter.whiten(row) for row in np.eye(SIZE)]).T
    white = columns.reshape(COUNT, SIZE)
    covariance = np.eye(SIZE) + white.T @ white
    agree(whiten @ covariance @ whiten.T, np.eye(SIZE), SOLVED, 1.0)
    # Negative control: without the filter, the covariance is not the identity.
    assert np.abs(covariance - np.eye(SIZE)).max() > 1.0


def test_estimate_is_the_mean_of_a_gaussian_process(columns):
    residual = np.random.default_rng(2).standard_normal(SIZE)
    white = columns.reshape(COUNT, SIZE)
    kernel = white.T @ white
    expected = kernel @ np.linalg.solve(np.eye(SIZE) + kernel, residual)
    agree(build_filter(columns).estimate_form(residual).ravel(), expected, SOLVED, 1.0)


def test_estimates_of_the_owners_add_up(columns):
    residual, form_filter = np.random.default_rng(2).standard_normal(SIZE), build_filter(columns)
    parts = [form_filter.estimate_form(residual, owner) for owner in form_filter.owners]
    agree(sum(parts), form_filter.estimate_form(residual), SOLVED, 1.0)
    assert not parts[2].any()
    assert parts[0].any()
    assert parts[1].any()


def test_prediction_sd_is_that_of_a_gaussian_process(columns):
    slope, prior_sd = np.random.default_rng(3).standard_normal((1, 2, ROWS)), 2.0
    both = np.concatenate([slope, columns])
    white = both.reshape(1 + COUNT, SIZE)
    kernel = white[1:].T @ white[1:] + prior_sd**2 * white[:1].T @ white[:1]
    variance = np.diag(kernel - kernel @ np.linalg.solve(np.eye(SIZE) + kernel, kernel))
    precision = np.array([1 / prior_sd**2, 1.0, 1.0, 1.0])
    sd = compute_prediction_sd(both, white, precision)
    agree(sd.ravel(), np.sqrt(variance), 1e-6)


def test_most_likely_share_of_a_single_column():
    """−2 ln L = ln(1 + ε² g) − ε² b² / (1 + ε² g) of one column is smallest at ε² = b²/g² − 1/g."""
    column = np.full(SIZE, 3.0)
    g = column @ column
    for share in (0.0, 0.03, 0.1, 0.3):
        residual = np.sqrt(share**2 + 1 / g) * column
        cost = FormCost(residual, np.zeros((SIZE, 0)), np.zeros(0), np.zeros(0), [column[None]])
        expected = np.log1p(share**2 * g) - share**2 * (column @ residual) ** 2 / (1 + share**2 * g)
        agree(cost.evaluate((share,)), expected, SOLVED, 1.0) if share else None
        assert choose_shares(cost) == pytest.approx((share,))
