"""The likelihood of correlated noise agrees with the Gaussian of its covariance matrix."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import multivariate_normal

from pamjax.infer.noise.ar1_filter import Ar1Noise
from pamjax.infer.posterior.ar1_likelihood import Ar1Likelihood
from pamjax.infer.problem.whitening import compute_filter
from tests.agreement import BY_DIFFERENCE, ROUNDING, agree, difference

#: Two runs of four samples, of which the second row was not measured.
MEASURED = np.array([1, 0, 1, 1, 1, 1, 1, 1.0])
RUN = np.array([0, 0, 0, 0, 1, 1, 1, 1])
ROWS, POSITION = [0, 2, 3, 4, 5, 6, 7, 0], [0, 1, 2, 0, 1, 2, 3, -1]


def build_likelihood(propagated_sd):
    arrays = (MEASURED, np.array(ROWS), np.array(POSITION), np.full(8, propagated_sd))
    return Ar1Likelihood(0, 0, 1, *map(jnp.asarray, arrays))


def by_matrix(misfit, sd, memory, propagated_sd):
    """Return the log-density; the sensor has the correlation memory^(lag) within a run."""
    measured = MEASURED > 0
    order = np.cumsum(measured)
    lag = np.abs(order[:, None] - order[None])
    sensor = sd**2 * np.where(RUN[:, None] == RUN[None], float(memory) ** lag, 0.0)
    covariance = (sensor + propagated_sd**2 * np.eye(8))[np.ix_(measured, measured)]
    return multivariate_normal(cov=covariance).logpdf(misfit[measured])


@pytest.mark.parametrize("propagated_sd", [0.0, 0.4, 3.0])
@pytest.mark.parametrize("memory", [-0.3, 0.0, 0.8])
def test_likelihood_agrees_with_the_gaussian(memory, propagated_sd):
    misfit = np.random.default_rng(1).normal(size=8) * MEASURED
    likelihood = build_likelihood(propagated_sd)
    log_density = likelihood.compute_log_density(jnp.asarray(misfit), jnp.array([1.3, memory])).sum()
    agree(log_density, by_matrix(misfit, 1.3, memory, propagated_sd), ROUNDING)


@pytest.mark.parametrize("memory", [0.0, 0.8])
@pytest.mark.parametrize("propagated_sd", [0.0, 0.4])
def test_derivatives_agree_with_differences(memory, propagated_sd):
    misfit = jnp.asarray(np.random.default_rng(1).normal(size=8) * MEASURED)
    likelihood = build_likelihood(propagated_sd)

    def total(sd, memory):
        return likelihood.compute_log_density(misfit, jnp.array([sd, memory])).sum()

    by_sd, by_memory = jax.grad(total, argnums=(0, 1))(1.3, memory)
    agree(by_sd, difference(lambda sd: total(sd, memory), 1.3, 1e-5), BY_DIFFERENCE)
    agree(by_memory, difference(lambda r: total(1.3, r), memory, 1e-5), BY_DIFFERENCE)


def test_noise_is_that_of_a_fit():
    """The compiled filter has the coefficients of the noise model of `fit` and `diagnose`."""
    position = np.arange(300)
    feedback, sd = compute_filter(0.6, 0.97, jnp.asarray(position))
    noise = Ar1Noise(np.ones(1), 0.6, 0.97, True)
    # `Ar1Noise` counts as steady within a tolerance.
    agree(feedback[1:], noise.compute_coefficients(300)[0][1:], 1e-3)
    agree(sd, noise.compute_coefficients(300)[1], 1e-3)


def test_likelihood_depends_on_the_correlation():
    misfit = np.random.default_rng(1).normal(size=8) * MEASURED
    likelihood = build_likelihood(0.4)
    log_density = float(likelihood.compute_log_density(jnp.asarray(misfit), jnp.array([1.3, 0.5])).sum())
    assert abs(log_density - by_matrix(misfit, 1.3, 0.6, 0.4)) > 0.01


@pytest.mark.slow
def test_information_is_the_mean_curvature():
    # 4000 samples of sensor noise without input noise: the mean curvature is the information.
    n, sd, memory = 4000, 2.0, 0.7
    random = np.random.default_rng(3)
    s = np.zeros(n)
    for i in range(n):
        s[i] = random.normal() if i == 0 else memory * s[i - 1] + np.sqrt(1 - memory**2) * random.normal()
    likelihood = Ar1Likelihood(0, 0, 1, jnp.ones(n), jnp.arange(n), jnp.arange(n), jnp.zeros(n))

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
