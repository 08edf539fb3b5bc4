"""Effective samples of chains whose autocorrelation is known, and chains that do not agree."""

import numpy as np
import pytest
from scipy.signal import lfilter

from pamjax.infer.posterior.convergence import compute_convergence, compute_ess


def autoregressive(memory, n=4000, chains=8, seed=0):
    new = np.random.default_rng(seed).standard_normal((n, chains))
    return lfilter([np.sqrt(1 - memory**2)], [1, -memory], new, axis=0)


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.9])
def test_effective_samples_of_a_known_chain(memory):
    x = autoregressive(memory)
    wanted = x.size * (1 - memory) / (1 + memory)
    assert abs(compute_ess(x) / wanted - 1) < 0.15


def test_chains_that_agree_pass_and_others_do_not():
    x = autoregressive(0.5)[:, :, None]
    assert compute_convergence(x).is_converged(1000, 1.01, check_length=True)
    apart = x.copy()
    apart[:, 0] += 1.0
    assert compute_convergence(apart).rhat[0] > 1.05
    assert not compute_convergence(apart).is_converged(1000, 1.01, check_length=True)


def test_a_drifting_chain_does_not_pass():
    x = autoregressive(0.5)[:, :, None] + np.linspace(0, 2, 4000)[:, None, None]
    assert compute_convergence(x).rhat[0] > 1.1


def test_a_short_chain_is_not_trusted():
    x = autoregressive(0.9, n=300, chains=64)[:, :, None]
    assert compute_convergence(x).is_converged(500, 1.1, check_length=False)
    assert not compute_convergence(x).is_converged(500, 1.1, check_length=True)
