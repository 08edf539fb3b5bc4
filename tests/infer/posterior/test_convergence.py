"""Effective samples of chains whose autocorrelation is known, and chains that do not agree."""

import numpy as np
import pytest
from scipy.signal import lfilter

from pamjax.infer.posterior.convergence import effective, health


def autoregressive(memory, n=4000, chains=8, seed=0):
    new = np.random.default_rng(seed).standard_normal((n, chains))
    return lfilter([np.sqrt(1 - memory**2)], [1, -memory], new, axis=0)


@pytest.mark.parametrize("memory", [0.0, 0.5, 0.9])
def test_effective_samples_of_a_known_chain(memory):
    x = autoregressive(memory)
    wanted = x.size * (1 - memory) / (1 + memory)
    assert abs(effective(x) / wanted - 1) < 0.15


def test_chains_that_agree_pass_and_others_do_not():
    x = autoregressive(0.5)[:, :, None]
    assert health(x).good(1000, 1.01, long=True)
    apart = x.copy()
    apart[:, 0] += 1.0
    assert health(apart).rhat[0] > 1.05
    assert not health(apart).good(1000, 1.01, long=True)


def test_a_drifting_chain_does_not_pass():
    x = autoregressive(0.5)[:, :, None] + np.linspace(0, 2, 4000)[:, None, None]
    assert health(x).rhat[0] > 1.1


def test_a_short_chain_is_not_trusted():
    x = autoregressive(0.9, n=300, chains=64)[:, :, None]
    assert health(x).good(500, 1.1, long=False)
    assert not health(x).good(500, 1.1, long=True)
