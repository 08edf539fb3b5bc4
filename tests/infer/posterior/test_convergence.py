"""Effective sample size of chains with known autocorrelation, and R-hat of chains that disagree."""

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.stats import norm, rankdata

from pamjax.infer.posterior.convergence import compute_convergence


def autoregressive(correlation, n=4000, chains=8, seed=0):
    new = np.random.default_rng(seed).standard_normal((n, chains))
    return lfilter([np.sqrt(1 - correlation**2)], [1, -correlation], new, axis=0)[:, :, None]


@pytest.mark.parametrize("correlation", [0.0, 0.5, 0.9])
def test_effective_samples_of_a_known_chain(correlation):
    x = autoregressive(correlation)
    wanted = x.size * (1 - correlation) / (1 + correlation)
    diagnostics = compute_convergence(x)
    assert abs(diagnostics.ess[0] / wanted - 1) < 0.15
    assert diagnostics.autocorrelation_time[0] == x.size / diagnostics.ess[0]


def test_rhat_equals_its_definition():
    x = autoregressive(0.9, n=300, chains=6)[:, :, 0]
    halves = np.concatenate([x[:150], x[150:]], axis=1)
    # Vehtari et al. 2021, Eqs. 1-4 and 14.
    scores = norm.ppf((rankdata(halves).reshape(halves.shape) - 3 / 8) / (halves.size + 1 / 4))
    within = scores.var(axis=0, ddof=1).mean()
    total = 149 / 150 * within + scores.mean(axis=0).var(ddof=1)
    assert abs(compute_convergence(x[:, :, None]).rhat[0] - np.sqrt(total / within)) < 1e-12


def test_each_parameter_has_its_own_diagnostics():
    first, second = autoregressive(0.0), autoregressive(0.9, seed=1)
    both = compute_convergence(np.concatenate([first, second], axis=2))
    for k, x in enumerate((first, second)):
        alone = compute_convergence(x)
        assert (both.ess[k], both.rhat[k]) == (alone.ess[0], alone.rhat[0])


def test_chains_that_agree_converge_and_others_do_not():
    x = autoregressive(0.5)
    assert compute_convergence(x).is_converged(1000, 1.01, check_length=True)
    apart = x.copy()
    apart[:, 0] += 1.0
    assert compute_convergence(apart).rhat[0] > 1.05
    assert not compute_convergence(apart).is_converged(1000, 1.01, check_length=True)


def test_a_drifting_chain_does_not_converge():
    x = autoregressive(0.5) + np.linspace(0, 2, 4000)[:, None, None]
    assert compute_convergence(x).rhat[0] > 1.1


def test_a_constant_chain_does_not_converge():
    diagnostics = compute_convergence(np.ones((300, 4, 1)))
    assert diagnostics.ess[0] == 1.0
    assert not diagnostics.is_converged(1, 1.1, check_length=False)


def test_a_short_chain_does_not_converge():
    x = autoregressive(0.9, n=300, chains=64)
    assert compute_convergence(x).is_converged(500, 1.1, check_length=False)
    assert not compute_convergence(x).is_converged(500, 1.1, check_length=True)
