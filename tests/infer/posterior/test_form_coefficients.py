"""Coefficients of form errors agree with the closed form of a linear model with AR(1) noise."""

import dataclasses
import math

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import multivariate_normal

from pamjax.infer.posterior.ar1_likelihood import Ar1Likelihood
from pamjax.infer.posterior.form_coefficients import FormColumns
from pamjax.infer.posterior.laplace import fit_laplace
from pamjax.infer.posterior.log_density import PosteriorDensity
from pamjax.infer.posterior.predictive import draw_coefficients, predict_channels
from pamjax.infer.problem.form_filter import FormFilter
from pamjax.infer.problem.parameter_space import FreeParameter, build_space
from pamjax.infer.problem.whitening import pack_samples
from pamjax.parameter import Meaning
from tests.agreement import SAMPLED, SOLVED, agree

#: Two runs of 18 and 12 samples, and two rows of padding.
RUNS, SIZE = (18, 12), 32
N = sum(RUNS)
RANDOM = np.random.default_rng(3)
SLOPE = np.pad(RANDOM.normal(size=N), (0, SIZE - N))
#: The last column is nearly parallel to the slope: the form error then widens the posterior.
COLUMNS = np.pad(
    np.stack([RANDOM.normal(size=N), np.linspace(-3, 3, N), 2 * SLOPE[:N] + 0.1 * RANDOM.normal(size=N)]),
    ((0, 0), (0, SIZE - N)),
)
MEASURED = np.pad(1.5 * SLOPE[:N] + COLUMNS[1, :N] + RANDOM.normal(size=N), (0, SIZE - N))
PROPAGATED_SD = np.full(SIZE, 0.6)
#: Slope, sd and correlation of the noise.
VALUES = np.array([1.3, 0.9, 0.55])


class LinearDataset(eqx.Module):
    """A dataset whose force is linear in one parameter; no diameter is measured."""

    measured: jnp.ndarray

    def compute_standardised_residuals(self, values):
        residual = self.measured - SLOPE * values[0]
        return residual, jnp.zeros_like(residual)

    def predict_channels(self, values):
        return jnp.stack([SLOPE * values[0], jnp.zeros(SIZE)])


def build_density(columns=COLUMNS, power=1.0, noise_sd=0.2):
    """Return the posterior density with Gaussian priors: slope 1 ± 2, noise ± `noise_sd` of its value."""
    meanings = [
        Meaning("1", "1", low, high, "linear", "", "")
        for low, high in ((-100.0, 100.0), (0.01, 10.0), (-0.9, 0.9))
    ]
    sds = (2.0, noise_sd * VALUES[1], noise_sd * VALUES[2])
    starts = (1.0, *VALUES[1:])
    space = build_space(
        [
            FreeParameter(name, *rest)
            for name, *rest in zip(("slope", "sd", "correlation"), meanings, starts, sds, strict=True)
        ]
    )
    rows = np.arange(N)
    order, position = pack_samples(rows, np.isin(rows, (0, RUNS[0])), SIZE)
    measured = jnp.asarray((np.arange(SIZE) < N).astype(float))
    likelihood = Ar1Likelihood(0, 1, 2, measured, *map(jnp.asarray, (order, position, PROPAGATED_SD)))
    stacked = np.stack([columns, np.zeros_like(columns)], axis=1)
    form = FormColumns(jnp.asarray(stacked), ("contact_pressure",) * len(columns))
    dataset = LinearDataset(jnp.asarray(MEASURED))
    return PosteriorDensity((dataset,), ((likelihood,),), ((jnp.asarray(power),),), (form,), space)


def build_noise_covariance():
    """Return the covariance of the AR(1) noise of `ar1_likelihood.py`, (N, N)."""
    variance = VALUES[1] ** 2 + PROPAGATED_SD[0] ** 2
    fraction = VALUES[1] ** 2 / variance
    run, k = np.repeat((0, 1), RUNS), np.arange(N)
    correlation = fraction * VALUES[2] ** np.abs(k[:, None] - k) * (run[:, None] == run)
    np.fill_diagonal(correlation, 1.0)
    return variance * correlation


def evaluate(density):
    return float(
        density.compute_log_likelihood(
            density.space.to_point(dict(zip(density.space.names, VALUES, strict=True)))
        )
    )


@pytest.mark.slow
def test_likelihood_is_the_gaussian_with_both_covariances():
    covariance = build_noise_covariance() + COLUMNS[:, :N].T @ COLUMNS[:, :N]
    exact = multivariate_normal(np.zeros(N), covariance).logpdf((MEASURED - SLOPE * VALUES[0])[:N])
    agree(evaluate(build_density()), exact, SOLVED)
    # The form errors matter: without them, the likelihood is another one.
    without = evaluate(build_density(np.zeros((0, SIZE))))
    agree(
        without,
        multivariate_normal(np.zeros(N), build_noise_covariance()).logpdf((MEASURED - SLOPE * VALUES[0])[:N]),
        SOLVED,
    )
    assert abs(without - exact) > 10


def test_power_widens_the_noise_and_not_the_form_errors():
    power = 0.4
    residual = (MEASURED - SLOPE * VALUES[0])[:N]
    noise = build_noise_covariance() / power
    factor = multivariate_normal(np.zeros(N), noise + COLUMNS[:, :N].T @ COLUMNS[:, :N]).logpdf(
        residual
    ) - multivariate_normal(np.zeros(N), noise).logpdf(residual)
    density = build_density(power=power)
    agree(float(density.compute_coefficients(0, jnp.asarray(VALUES)).log_factor), factor, SOLVED)


def compute_exact_coefficients():
    """Return mean and covariance of the coefficients by generalised least squares."""
    inverse = np.linalg.inv(build_noise_covariance())
    columns = COLUMNS[:, :N]
    covariance = np.linalg.inv(np.eye(len(columns)) + columns @ inverse @ columns.T)
    return covariance @ columns @ inverse @ (MEASURED - SLOPE * VALUES[0])[:N], covariance


def test_draws_of_coefficients_have_the_exact_mean_and_covariance():
    mean, covariance = compute_exact_coefficients()
    count = 4000
    draws = draw_coefficients(build_density(), np.tile(VALUES, (count, 1)), 0, seed=1)
    sd = np.sqrt(np.diag(covariance))
    assert np.all(np.abs(draws.mean(axis=0) - mean) < SAMPLED * sd / math.sqrt(count))
    correlation = np.corrcoef(draws, rowvar=False)
    assert np.all(np.abs(correlation - covariance / np.outer(sd, sd)) < SAMPLED / math.sqrt(count))
    assert np.all(np.abs(draws.std(axis=0) / sd - 1) < SAMPLED / math.sqrt(2 * count))
    np.testing.assert_array_equal(
        draws, draw_coefficients(build_density(), np.tile(VALUES, (count, 1)), 0, 1)
    )


def test_likelihood_and_draws_fulfil_the_theorem_of_bayes():
    """ln p(e | θ) = ln p(e | θ, c) + ln p(c) − ln p(c | θ, e) for any coefficients c."""
    density, coefficients = build_density(), np.array([0.4, -0.7, 1.1])
    u = density.space.to_point(dict(zip(density.space.names, VALUES, strict=True)))
    ((by_sample,),) = density.compute_sample_log_densities(u, [jnp.asarray(coefficients)])
    joint = float(by_sample.sum()) + multivariate_normal(np.zeros(3), np.eye(3)).logpdf(coefficients)
    agree(
        evaluate(density),
        joint - multivariate_normal(*compute_exact_coefficients()).logpdf(coefficients),
        SOLVED,
    )


@pytest.mark.slow
def test_gaussian_approximation_has_the_information_of_generalised_least_squares():
    density = build_density(noise_sd=1e-4)
    gaussian = fit_laplace(density, jnp.zeros(3))
    slope = 200 / 4 * float(density.space.width[0]) * (1 - (gaussian_value(density, gaussian) / 100) ** 2)
    sd = slope * float(jnp.sqrt((gaussian.covariance_root @ gaussian.covariance_root.T)[0, 0]))
    covariance = build_noise_covariance() + COLUMNS[:, :N].T @ COLUMNS[:, :N]
    information = SLOPE[:N] @ np.linalg.solve(covariance, SLOPE[:N])
    assert sd == pytest.approx(1 / math.sqrt(information + 1 / 2**2), rel=0.02)
    without = SLOPE[:N] @ np.linalg.solve(build_noise_covariance(), SLOPE[:N])
    assert sd > 2 / math.sqrt(without + 1 / 2**2)


def gaussian_value(density, gaussian):
    return float(density.space.to_values(gaussian.centre)[0])


def test_prediction_includes_the_form_error_of_its_draw():
    density, coefficients = build_density(), np.array([[0.0, 0.0, 0.0], [1.0, -2.0, 0.5]])
    force = predict_channels(density, np.tile(VALUES, (2, 1)), coefficients, 0)["force"]
    agree(force[0], SLOPE * VALUES[0], SOLVED)
    agree(force[1] - force[0], coefficients[1] @ COLUMNS, SOLVED, scale=1.0)


def test_innovations_are_those_of_the_residual_without_form_error():
    """χ² of innovations and coefficients is that of noise and form errors together."""
    density = build_density()
    u = density.space.to_point(dict(zip(density.space.names, VALUES, strict=True)))
    ((innovations,),), (coefficients,) = density.compute_innovations(u)
    residual = (MEASURED - SLOPE * VALUES[0])[:N]
    covariance = build_noise_covariance() + COLUMNS[:, :N].T @ COLUMNS[:, :N]
    chi2 = float(jnp.sum(innovations**2) + jnp.sum(coefficients**2))
    agree(chi2, residual @ np.linalg.solve(covariance, residual), SOLVED)
    agree(np.asarray(coefficients), compute_exact_coefficients()[0], SOLVED, scale=1.0)


def test_form_errors_of_size_zero_have_no_coefficients():
    columns = np.stack([COLUMNS, np.zeros_like(COLUMNS)], axis=1)
    columns[1] = 0.0
    form_filter = FormFilter.from_columns(columns, columns.reshape(3, -1), ("a", "b", "c"))
    form = FormColumns.from_filter(form_filter, SIZE)
    assert form.owners == ("a", "c")
    agree(np.asarray(form.columns), columns[[0, 2]], 0.0)
    assert FormColumns.from_filter(None, SIZE).count == 0
    empty = dataclasses.replace(build_density(), forms=(FormColumns.from_filter(None, SIZE),))
    assert not empty.has_form_errors
    assert draw_coefficients(empty, np.tile(VALUES, (5, 1)), 0, 0).shape == (5, 0)
