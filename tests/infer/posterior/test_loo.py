"""Leaving a block out by importance against leaving it out."""

import warnings

import numpy as np
import pytest
from scipy.stats import genpareto, norm

from pamjax.infer.posterior.loo import compute_loo_score, fit_pareto, smooth_log_weights


def test_a_known_law_is_found():
    x = np.sort(genpareto.rvs(0.3, scale=2.0, size=4000, random_state=1))
    shape, scale = fit_pareto(x)
    assert abs(shape - 0.3) < 0.08
    assert abs(scale / 2 - 1) < 0.1


def test_a_mean_predicted_without_its_block():
    # Eight blocks of one normal reading of unit sd around an unknown mean: all is known in closed form.
    random = np.random.default_rng(2)
    y = random.normal(size=8)
    draws = random.normal(y.mean(), np.sqrt(1 / 8), size=20_000)
    for k in range(8):
        others = np.delete(y, k)
        wanted = norm(others.mean(), np.sqrt(1 + 1 / 7)).logpdf(y[k])
        found, shape = compute_loo_score(norm(draws, 1.0).logpdf(y[k]))
        assert shape < 0.7
        assert abs(found - wanted) < 0.03
        # In-sample it looks better than it is.
        assert norm(y.mean(), np.sqrt(1 + 1 / 8)).logpdf(y[k]) > wanted


def test_a_block_that_moved_the_posterior_is_not_trusted():
    random = np.random.default_rng(2)
    draws = random.normal(0.0, 0.1, size=4000)
    _, shape = compute_loo_score(norm(draws, 0.03).logpdf(0.5))
    assert shape > 0.7


@pytest.mark.slow
def test_arviz_says_the_same():
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        import arviz

        ratios = 1.5 * np.random.default_rng(3).normal(size=1000)
        theirs, shape = arviz.psislw(ratios)
    mine, own = smooth_log_weights(ratios)
    assert abs(own - shape) < 1e-6
    np.testing.assert_allclose(mine - np.log(np.exp(mine).sum()), theirs, atol=1e-6)
