"""The likelihood of AR(1) noise agrees with the Gaussian of its covariance matrix."""

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import multivariate_normal

from pamjax.infer.posterior.ar1_likelihood import Ar1Likelihood
from tests.agreement import ROUNDING, agree, difference

#: Two runs of four samples, of which the second row was not measured.
THERE = np.array([1, 0, 1, 1, 1, 1, 1, 1.0])
RUN = np.array([0, 0, 0, 0, 1, 1, 1, 1])
BEFORE = np.array([0, 0, 0, 2, 3, 4, 5, 6])
LINKED = np.array([0, 0, 1, 1, 0, 1, 1, 1.0])
CARRIED = np.linspace(0.5, 1.5, 8)


def stream():
    return Ar1Likelihood(0, 0, 1, *map(jnp.asarray, (THERE, LINKED, BEFORE, CARRIED)))


def by_matrix(misfit, sd, memory):
    """Return the log-density with correlation memory^(lag) within a run, and none between runs."""
    there = THERE > 0
    order = np.cumsum(there)
    apart = np.abs(order[:, None] - order[None])
    correlation = np.where(RUN[:, None] == RUN[None], float(memory) ** apart, 0.0)
    scale = np.sqrt(sd**2 + CARRIED**2)
    covariance = (correlation * np.outer(scale, scale))[np.ix_(there, there)]
    return multivariate_normal(cov=covariance).logpdf(misfit[there])


@pytest.mark.parametrize("memory", [-0.3, 0.0, 0.8])
def test_likelihood_agrees_with_the_gaussian(memory):
    misfit = np.random.default_rng(1).normal(size=8) * THERE
    log_density = stream().compute_log_density(jnp.asarray(misfit), jnp.array([1.3, memory])).sum()
    agree(log_density, by_matrix(misfit, 1.3, memory), ROUNDING)


def test_likelihood_depends_on_the_correlation():
    misfit = np.random.default_rng(1).normal(size=8) * THERE
    log_density = float(stream().compute_log_density(jnp.asarray(misfit), jnp.array([1.3, 0.5])).sum())
    assert abs(log_density - by_matrix(misfit, 1.3, 0.6)) > 0.01


def test_information_is_the_mean_curvature():
    # 4000 samples of sensor noise without input noise: the mean curvature is the information.
    n, sd, memory = 4000, 2.0, 0.7
    random = np.random.default_rng(3)
    s = np.zeros(n)
    for i in range(n):
        s[i] = random.normal() if i == 0 else memory * s[i - 1] + np.sqrt(1 - memory**2) * random.normal()
    likelihood = Ar1Likelihood(0, 0, 1, jnp.ones(n), jnp.ones(n).at[0].set(0.0), None, jnp.zeros(n))

    def slope(log_sd):
        return difference(
            lambda r: likelihood.compute_log_density(
                jnp.asarray(sd * s), jnp.array([np.exp(log_sd), r])
            ).sum(),
            memory,
            1e-4,
        )

    across = -difference(slope, np.log(sd), 1e-4)
    information = likelihood.compute_information(jnp.array([sd, memory]))
    agree(across, information[0, 1], 0.1)
