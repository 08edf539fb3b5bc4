"""The leave-one-block-out score by importance sampling equals the one in closed form."""

import math

import numpy as np
import pytest
from scipy.stats import genpareto, norm

from pamjax.infer.posterior.loo import compute_loo_score


@pytest.mark.parametrize("shape", [0.1, 0.3, 0.5])
def test_the_shape_of_pareto_distributed_weights_is_estimated(shape):
    weights = genpareto.rvs(shape, scale=2.0, size=40_000, random_state=1)
    assert abs(compute_loo_score(-np.log(weights))[1] - shape) < 0.08


def test_the_shape_agrees_with_maximum_likelihood():
    # Of 4000 weights, psis smooths the 189 largest (Vehtari et al. 2024).
    log_weights = np.random.default_rng(3).normal(0.0, 1.5, size=4000)
    weights = np.sort(np.exp(log_weights))
    shape, _, _ = genpareto.fit(weights[-189:] - weights[-190], floc=0.0)
    # Its weak prior counts as ten weights with shape 0.5.
    wanted = (189 * shape + 10 * 0.5) / 199
    assert abs(compute_loo_score(-log_weights)[1] - wanted) < 0.02


def test_the_score_of_a_held_out_block_equals_the_closed_form():
    # Eight blocks of one normal reading with unit sd around an unknown mean.
    random = np.random.default_rng(2)
    y = random.normal(size=8)
    draws = random.normal(y.mean(), np.sqrt(1 / 8), size=20_000)
    for k in range(8):
        others = np.delete(y, k)
        wanted = norm(others.mean(), np.sqrt(1 + 1 / 7)).logpdf(y[k])
        score, shape = compute_loo_score(norm(draws, 1.0).logpdf(y[k]))
        assert shape < 0.7
        assert abs(score - wanted) < 0.03
        # The score with the block included is higher.
        assert norm(y.mean(), np.sqrt(1 + 1 / 8)).logpdf(y[k]) > wanted


def test_the_score_of_an_influential_block_is_not_reliable():
    random = np.random.default_rng(2)
    draws = random.normal(0.0, 0.1, size=4000)
    _, shape = compute_loo_score(norm(draws, 0.03).logpdf(0.5))
    assert shape > 0.7


def test_without_a_pareto_fit_the_score_is_not_reliable():
    # One draw has all the weight: the others underflow.
    log_likelihood = np.zeros(1000)
    log_likelihood[7] = -2000.0
    score, shape = compute_loo_score(log_likelihood)
    assert shape == math.inf
    assert abs(score - (math.log(1000) - 2000)) < 1e-9
    # Too few draws for a tail.
    assert compute_loo_score(np.linspace(-1, 0, 10))[1] == math.inf


def test_the_score_of_a_block_without_influence_is_its_likelihood():
    assert compute_loo_score(np.full(1000, -3.0)) == (-3.0, 0.0)
