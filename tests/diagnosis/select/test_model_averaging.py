"""Model averaging: estimates and sd include other models that fit equally well."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax.diagnosis.library.candidates import build_candidates
from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.refit.least_squares import fit_parameters
from pamjax.diagnosis.refit.model_fit import fit_model, get_free_indices, switch_on_candidate
from pamjax.diagnosis.select.model_averaging import _weigh_minima, average_models
from pamjax.diagnosis.select.rivals import NamedMechanism, RivalFit
from tests.diagnosis.bank import BankRecording, simulate_bank
from tests.diagnosis.plain_fits import build_fit

TOLERANCE = 4.0


def build_minimum(value, chi2=1000.0):
    """Return a minimum of a model with one parameter with an sd of 0.1."""
    jacobian = np.full((1, 1), 10.0)
    return build_fit([value], [0], n=1000, chi2=chi2, jacobian=jacobian, prior_sd=np.full(1, np.inf))


def test_a_minimum_that_fits_equally_well_has_the_same_weight():
    ((probability, shift),) = _weigh_minima(build_minimum(1.2), [build_minimum(-1.2)], TOLERANCE)
    assert probability == pytest.approx(0.5)
    assert shift == pytest.approx([-2.4])


def test_weight_of_a_minimum_is_its_likelihood():
    minima = [build_minimum(-1.2, 1000 + 2 * np.log(3)), build_minimum(4.0, 1000 + 2 * np.log(6))]
    weights = [probability for probability, _ in _weigh_minima(build_minimum(1.2), minima, TOLERANCE)]
    # The likelihoods are as 6 to 2 to 1; the misfit variance of these fits is 1.
    assert weights == pytest.approx([2 / 9, 1 / 9], rel=0.01)


def test_a_fit_within_the_uncertainty_is_no_other_minimum():
    near = [build_minimum(1.2 + 0.15), build_minimum(1.2 - 0.15)]
    assert _weigh_minima(build_minimum(1.2), near, TOLERANCE) == []
    # Two fits of the same other minimum count once.
    twice = [build_minimum(-1.2), build_minimum(-1.25)]
    assert len(_weigh_minima(build_minimum(1.2), twice, TOLERANCE)) == 1


def test_misfit_of_means_counts_as_that_of_their_samples():
    """A misfit of 0.4 of the variance of a sample is 3.6 times the variance of the mean of nine."""
    minimum = build_minimum(1.2, chi2=1000 * (1 + 3.6))
    means = replace(minimum, noise=replace(minimum.noise, samples_per_row=(9.0, 1.0)))
    assert means.variance_inflation == pytest.approx(1.4)
    assert minimum.variance_inflation == pytest.approx(4.6)


def fit_from_truth(ground_truth):
    """Return the problem of a recording with one mechanism, and its fit from the true values."""
    problem = build_library_problem(ground_truth.case)
    values = np.array([ground_truth.true_values[name] for name in problem.names])
    rows = np.ones(problem.n, dtype=bool)
    return problem, fit_model(problem, rows, ground_truth.candidates, values)


def test_sd_includes_the_shift_of_a_tie():
    """With an offset of the pressure instead of the force, the braid has other dimensions."""
    problem, fit = fit_from_truth(simulate_bank(BankRecording(1, only="force_offset")))
    (other,) = (c for c in build_candidates(problem) if c.id == "pressure_offset")
    baseline = np.flatnonzero(problem.is_baseline)
    start = switch_on_candidate(problem, problem.neutral, other, np.array([100.0]))
    start[baseline] = fit.estimate.values[baseline]
    tied = fit_parameters(problem, fit.noise, get_free_indices(problem, [other]), start)
    shift = tied.values - fit.estimate.values
    tie = NamedMechanism(
        "force_offset",
        0.9,
        ("pressure_offset",),
        50.0,
        indistinguishable_fits=(RivalFit(0.5, other, tied.values),),
    )
    averaged = average_models(problem, fit, (tie,))
    k = baseline[np.argmax(np.abs(shift[baseline] / [fit.sd(k) for k in baseline]))]
    assert abs(shift[k]) > fit.sd(k)
    assert averaged.sd(k) == pytest.approx(np.hypot(fit.sd(k), np.sqrt(0.5) * shift[k]), rel=0.02)
    # The parameters of the mechanism itself do not change.
    offset = problem.index("force_offset.offset")
    assert averaged.sd(offset) == pytest.approx(fit.sd(offset))
    # A mechanism that was removed from the model has no effect.
    gone = replace(tie, id="end_taper")
    assert average_models(problem, fit, (gone,)).sd(k) == pytest.approx(fit.sd(k))
