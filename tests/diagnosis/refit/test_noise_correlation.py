"""Autocorrelation of the noise from residuals of a model, if neighbouring samples do not determine it."""

from dataclasses import replace

import numpy as np

from pamjax.diagnosis.refit.least_squares import fit_parameters
from pamjax.diagnosis.refit.model_fit import ModelFit
from pamjax.diagnosis.refit.noise_correlation import fit_noise_correlation
from pamjax.infer.noise.ar1_filter import Ar1Noise
from pamjax.records.simulate import draw_ar1_noise
from tests.diagnosis.bank import replace_readings, simulate_without_noise
from tests.diagnosis.plain_fits import build_noise

#: True correlation of the slow part of the noise, its share of the variance, and sd of the force, N.
CORRELATION, SLOW_SHARE, FORCE_SD = 0.9, 0.3, 3.0
RECORDINGS = 30
#: Free parameters without a prior; all change the force slowly.
FREE = ("muscle.thread_length", "force_offset.offset", "force_drift.rate", "force_drift.bend")


def build_problem(seed, correlation=CORRELATION):
    """Return readings of the force of the stated muscle, with noise that is partly correlated."""
    problem, rng = simulate_without_noise(), np.random.default_rng(seed)
    noise = np.sqrt(SLOW_SHARE) * draw_ar1_noise(rng, problem.n, correlation)
    noise += np.sqrt(1 - SLOW_SHARE) * rng.standard_normal(problem.n)
    measured = np.stack([problem.measured[0] + FORCE_SD * noise, np.full(problem.n, np.nan)])
    return replace(replace_readings(problem, measured), prior_sd=np.full(len(problem.names), np.inf))


def fit_with_correlation(problem, correlation, stated=True):
    """Return a fit with an assumed correlation."""
    noise = build_noise(Ar1Noise(np.full(problem.n, FORCE_SD), SLOW_SHARE, correlation, stated))
    free = [problem.index(name) for name in FREE]
    return ModelFit((), noise, fit_parameters(problem, noise, free, problem.neutral))


def get_correlation(fit):
    return fit.noise.by_channel[0].correlation


def compute_mean_error(fits):
    """Return the mean absolute error of all estimates in units of their sd."""
    truth = simulate_without_noise().neutral
    errors = [abs(fit.estimate.values[k] - truth[k]) / fit.sd(k) for fit in fits for k in fit.estimate.free]
    return np.mean(errors)


def test_correlation_is_estimated_from_the_residuals():
    problems = [build_problem(seed) for seed in range(RECORDINGS)]
    before = [fit_with_correlation(problem, 0.4) for problem in problems]
    after = [fit_noise_correlation(problem, fit) for problem, fit in zip(problems, before, strict=True)]
    correlations = np.array([get_correlation(fit) for fit in after])
    assert abs(correlations.mean() - CORRELATION) < 3 * correlations.std() / np.sqrt(RECORDINGS) + 0.01
    # The mean absolute value of a standard normal variable is 0.8.
    assert 0.6 < compute_mean_error(after) < 1.0
    # Negative control: with the correlation of neighbouring samples, the reported sd are too small.
    assert compute_mean_error(before) > 1.1


def test_uncorrelated_noise_stays_uncorrelated():
    correlations = []
    for seed in range(RECORDINGS):
        problem = build_problem(seed, 0.0)
        fit = fit_noise_correlation(problem, fit_with_correlation(problem, 0.0))
        correlations.append(get_correlation(fit))
    # A third of the variance determines the correlation of a single recording badly.
    assert np.median(correlations) < 0.1


def test_unstated_sensor_and_misfit_leave_the_noise_unchanged():
    problem = build_problem(0)
    unstated = fit_with_correlation(problem, 0.4, stated=False)
    assert fit_noise_correlation(problem, unstated) is unstated
    stated = fit_with_correlation(problem, 0.4)
    misfit = replace(stated, noise=replace(stated.noise, weight=0.5))
    assert fit_noise_correlation(problem, misfit) is misfit
    # Negative control: without both, the correlation changes.
    assert fit_noise_correlation(problem, stated) is not stated
