"""Score tests: the part of the residual that a mechanism explains with permitted amplitudes."""

import dataclasses

import numpy as np
import pytest

from pamjax.diagnosis.detect.score_test import _fit_bounded_amplitudes, compute_score_directions
from pamjax.diagnosis.library.candidates import build_candidates
from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.refit.least_squares import fit_parameters
from pamjax.diagnosis.refit.model_fit import fit_model, get_free_indices
from tests.agreement import ROUNDING, agree
from tests.diagnosis.bank import BankRecording, simulate_bank

FREE = np.array([-np.inf, -np.inf]), np.array([np.inf, np.inf])

#: A recording with noise alone, whose program other tests compile too.
NOISE_ALONE = BankRecording(seed=5, correlation=0.0)


@pytest.fixture
def directions():
    return np.random.default_rng(5).standard_normal((2, 50)) * np.array([[1e-6], [1e4]])


def test_unbounded_amplitudes_agree_with_least_squares(directions):
    truth = np.array([3e5, -2e-4])
    amplitudes, gain = _fit_bounded_amplitudes(directions, truth @ directions, *FREE)
    agree(amplitudes, truth, to=ROUNDING, scale=np.abs(truth))
    agree(gain, np.sum((truth @ directions) ** 2), to=ROUNDING)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_amplitude_above_its_limit_explains_only_a_part(directions, share):
    direction = directions[:1]
    amplitudes, gain = _fit_bounded_amplitudes(
        direction, 3e5 * direction[0], np.array([0.0]), np.array([share * 3e5])
    )
    agree(amplitudes, [share * 3e5], to=ROUNDING)
    # The remaining fraction of |r|² is (1 − share)².
    agree(gain, (1 - (1 - share) ** 2) * np.sum((3e5 * direction) ** 2), to=ROUNDING)


def test_non_negative_amplitude_stays_non_negative(directions):
    amplitudes, gain = _fit_bounded_amplitudes(
        directions, np.array([-3e5, 2e-4]) @ directions, np.zeros(2), FREE[1]
    )
    assert amplitudes[0] == 0
    # The other amplitude then has its own least-squares value.
    alone = directions[1] @ (np.array([-3e5, 2e-4]) @ directions) / (directions[1] @ directions[1])
    agree(amplitudes[1], alone, to=ROUNDING)
    agree(gain, alone**2 * (directions[1] @ directions[1]), to=ROUNDING)


def test_form_without_effect_or_freedom_explains_nothing(directions):
    assert _fit_bounded_amplitudes(0 * directions, directions[0], *FREE) == (pytest.approx(np.zeros(2)), 0.0)
    assert _fit_bounded_amplitudes(directions, directions[0], np.zeros(2), np.zeros(2))[1] == 0.0


@pytest.mark.slow
def test_parameter_at_its_limit_absorbs_no_further_misfit():
    """A gain error of 10 % of the load cell moves the turns to the limit of their prior."""
    case = simulate_bank(NOISE_ALONE).case
    problem = build_library_problem(case)
    problem = dataclasses.replace(
        problem, measured=np.stack([1.1 * problem.measured[0], np.full(problem.n, np.nan)])
    )
    baseline = fit_model(problem, np.ones(problem.n, dtype=bool), (), problem.neutral)
    gain = next(form for form in build_candidates(problem) if form.id == "force_gain")
    (seen,) = compute_score_directions(problem, baseline.noise, baseline.estimate, [gain])
    # Not completely, because the amplitudes are linearised.
    assert seen.chi2_reduction > 0.7 * baseline.excess_chi2
    assert seen.amplitudes[0] == pytest.approx(0.1, rel=0.3)
    # Negative control: with all parameters projected out, as without limits, it explains almost nothing.
    along = seen.unit_vectors[:, : baseline.estimate.residual.size] @ baseline.estimate.residual
    assert float(along @ along) < 0.1 * baseline.excess_chi2


@pytest.mark.slow
def test_derivatives_without_memory_agree_with_two_passes():
    problem = build_library_problem(simulate_bank(NOISE_ALONE).case)
    places = range(len(problem.names))
    all_ids = {name.partition(".")[0] for name in problem.names}
    in_one_call = problem.predict_with_jacobian(problem.neutral, places)
    in_parts = [
        problem._run_sweep(problem.neutral, places[k : k + 16], [all_ids] * len(places[k : k + 16]))
        for k in range(0, len(places), 16)
    ]
    agree(in_one_call[0], in_parts[0][0], to=ROUNDING, scale=np.max(np.abs(in_one_call[0])))
    for slope, other in zip(in_one_call[1], np.concatenate([slopes for _, slopes in in_parts]), strict=True):
        agree(slope, other, to=1e-9, scale=np.max(np.abs(other)) + 1e-12)
    # Negative control: with one pass, a permanent effect is not visible.
    lasting = [
        k for k in places if problem.names[k] in ("braid_friction.constant", "viscoelastic_creep.modulus")
    ]
    assert np.all(
        np.max(np.abs(problem.predict_with_jacobian(problem.neutral, lasting)[1][:, 0]), axis=1) > 0
    )
    once = problem._run_sweep(problem.neutral, lasting, [()] * len(lasting))[1]
    assert not np.any(once)


@pytest.mark.slow
def test_form_explains_misfit_that_the_baseline_parameters_absorbed():
    """A gain error of 1 % of the load cell shifts the turns within their prior."""
    problem = build_library_problem(simulate_bank(NOISE_ALONE).case)
    problem = dataclasses.replace(
        problem, measured=np.stack([1.01 * problem.measured[0], np.full(problem.n, np.nan)])
    )
    baseline = fit_model(problem, np.ones(problem.n, dtype=bool), (), problem.neutral)
    gain = next(form for form in build_candidates(problem) if form.id == "force_gain")
    (seen,) = compute_score_directions(problem, baseline.noise, baseline.estimate, [gain])
    at = fit_parameters(problem, baseline.noise, get_free_indices(problem, (gain,)), baseline.estimate.values)
    assert seen.chi2_reduction == pytest.approx(
        baseline.estimate.chi2_with_priors - at.chi2_with_priors, rel=0.1
    )
    # Negative control: it explains another part of the residual alone.
    free = seen.unit_vectors[:, : baseline.estimate.residual.size] @ baseline.estimate.residual
    assert (
        abs(float(free @ free) - (baseline.estimate.chi2_with_priors - at.chi2_with_priors))
        > 0.2 * seen.chi2_reduction
    )
