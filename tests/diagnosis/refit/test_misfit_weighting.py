"""Misfit weighting: a smooth misfit does not change well-measured parameters."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax.diagnosis.refit.misfit_weighting import (
    fit_with_misfit_weight,
    reweight_by_misfit,
)
from pamjax.diagnosis.refit.model_fit import fit_model
from tests.diagnosis.bank import UNMODELLED_FORCES, replace_readings, simulate_without_noise


def build_problem(with_obstacle):
    """Return readings with white noise, and with an obstacle that the model lacks; priors are narrow."""
    problem, rng = simulate_without_noise(), np.random.default_rng(6)
    sensors = problem.case.muscle_toml.sensors
    sd = np.array([[sensors.force], [sensors.diameter]])
    measured = problem.measured + sd * rng.standard_normal((2, problem.n))
    if with_obstacle:
        measured[0] += UNMODELLED_FORCES["obstacle"](problem.case.recording)
    return replace(replace_readings(problem, measured), prior_sd=0.1 * problem.prior_sd)


def fit_baseline(problem, values=None):
    values = problem.neutral if values is None else values
    return fit_model(problem, np.ones(problem.n, bool), (), values)


def fit_weighted(problem, values=None):
    values = problem.neutral if values is None else values
    return fit_with_misfit_weight(problem, np.ones(problem.n, bool), (), values)


def compute_deviations(problem, fit):
    """Return the distances of thread length and turns from their priors, in prior sd."""
    stated = [problem.index("muscle.thread_length"), problem.index("muscle.turns")]
    return np.abs(fit.estimate.values - problem.start)[stated] / problem.prior_sd[stated]


def test_prior_is_kept_if_the_model_is_wrong():
    problem = build_problem(with_obstacle=True)
    fit = fit_baseline(problem)
    weighted = reweight_by_misfit(problem, fit)
    # Negative control: weighted by noise only, the obstacle moves both parameters by many prior sd.
    assert np.all(compute_deviations(problem, fit) > 10)
    assert np.all(compute_deviations(problem, weighted) < 2)
    k = problem.index("muscle.turns")
    assert weighted.sd(k) == pytest.approx(problem.prior_sd[k], rel=0.2)


def test_model_without_misfit_is_unchanged():
    problem = build_problem(with_obstacle=False)
    fit = fit_baseline(problem)
    assert reweight_by_misfit(problem, fit) is fit


def test_misfit_at_the_start_has_its_weight_from_the_start():
    problem = build_problem(with_obstacle=True)
    weighted = fit_weighted(problem)
    assert weighted.noise.weight < 0.1
    assert np.all(compute_deviations(problem, weighted) < 2)


def test_misfit_only_at_the_start_has_no_weight():
    problem = build_problem(with_obstacle=False)
    start = problem.neutral.copy()
    start[problem.index("muscle.thread_length")] -= 1e-3
    far = fit_weighted(problem, start)
    near = fit_weighted(problem)
    assert far.noise.weight == near.noise.weight == 1
    assert far.estimate.values == pytest.approx(near.estimate.values, rel=1e-4)
