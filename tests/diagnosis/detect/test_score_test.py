"""How much of a residual looks like a mechanism, at amplitudes that a muscle can have."""

import dataclasses

import numpy as np
import pytest

from pamjax.benchmark.inject_effect import inject_effects
from pamjax.diagnosis.detect.score_test import _fit_bounded_amplitudes, compute_score_directions
from pamjax.diagnosis.library.candidates import build_candidates
from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.refit.candidate_fit import fit_candidate, get_free_indices
from pamjax.diagnosis.refit.least_squares import fit_parameters
from tests.agreement import ROUNDING, agree

FREE = np.array([-np.inf, -np.inf]), np.array([np.inf, np.inf])


@pytest.fixture
def directions():
    return np.random.default_rng(5).standard_normal((2, 50)) * np.array([[1e-6], [1e4]])


def test_without_limits_the_best_amplitudes_are_those_of_least_squares(directions):
    truth = np.array([3e5, -2e-4])
    amplitudes, gain = _fit_bounded_amplitudes(directions, truth @ directions, *FREE)
    agree(amplitudes, truth, to=ROUNDING, scale=np.abs(truth))
    agree(gain, np.sum((truth @ directions) ** 2), to=ROUNDING)


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_a_form_that_would_need_more_than_a_muscle_has_explains_only_its_share(directions, share):
    one = directions[:1]
    amplitudes, gain = _fit_bounded_amplitudes(one, 3e5 * one[0], np.array([0.0]), np.array([share * 3e5]))
    agree(amplitudes, [share * 3e5], to=ROUNDING)
    # Of |r|² what is left is (1 − share)².
    agree(gain, (1 - (1 - share) ** 2) * np.sum((3e5 * one) ** 2), to=ROUNDING)


def test_an_amplitude_that_cannot_be_negative_is_not(directions):
    amplitudes, gain = _fit_bounded_amplitudes(
        directions, np.array([-3e5, 2e-4]) @ directions, np.zeros(2), FREE[1]
    )
    assert amplitudes[0] == 0
    # Then the other stands for what it can: its own least squares.
    alone = directions[1] @ (np.array([-3e5, 2e-4]) @ directions) / (directions[1] @ directions[1])
    agree(amplitudes[1], alone, to=ROUNDING)
    agree(gain, alone**2 * (directions[1] @ directions[1]), to=ROUNDING)


def test_what_does_not_show_or_cannot_move_explains_nothing(directions):
    assert _fit_bounded_amplitudes(0 * directions, directions[0], *FREE) == (pytest.approx(np.zeros(2)), 0.0)
    assert _fit_bounded_amplitudes(directions, directions[0], np.zeros(2), np.zeros(2))[1] == 0.0


def test_a_number_at_its_limit_absorbs_nothing_of_what_would_drive_it_further():
    """A load cell that reads a tenth too much drives the turns to the end of what the lab believes."""
    case = inject_effects(0, np.random.default_rng(5)).case
    found = build_library_problem(case)
    found = dataclasses.replace(found, measured=np.stack([1.1 * found.measured[0], np.full(found.n, np.nan)]))
    baseline = fit_candidate(found, np.ones(found.n, dtype=bool), (), found.neutral)
    gain = next(form for form in build_candidates(found) if form.id == "force_gain")
    (seen,) = compute_score_directions(found, baseline.noise, baseline.estimate, [gain])
    # Not quite all of it: amplitudes are linear here.
    assert seen.chi2_reduction > 0.7 * baseline.excess_chi2
    assert seen.amplitudes[0] == pytest.approx(0.1, rel=0.3)
    # Able to fail: what is freed of all numbers, as if they could move on, explains next to nothing.
    along = seen.unit_vectors[:, : baseline.estimate.residual.size] @ baseline.estimate.residual
    assert float(along @ along) < 0.1 * baseline.excess_chi2


def test_where_nothing_lasts_every_derivative_is_that_of_two_passes():
    found = build_library_problem(inject_effects(0, np.random.default_rng(5)).case)
    heavy = found.index("end_taper.share"), found.index("end_taper.radius")
    places = [k for k in range(len(found.names)) if k not in heavy]
    one = found.jacobian(found.neutral, places)
    two = [
        found._run_sweep(found.reduced_dataset, found.neutral, places[k : k + 16], True)
        for k in range(0, 80, 16)
    ]
    agree(one[0], two[0][0], to=ROUNDING, scale=np.max(np.abs(one[0])))
    for slope, other in zip(one[1], np.concatenate([slopes for _, slopes in two]), strict=True):
        agree(slope, other, to=1e-9, scale=np.max(np.abs(other)) + 1e-12)
    # Able to fail: with one pass what lasts would show nothing.
    lasting = [
        k for k in places if found.names[k] in ("braid_friction.constant", "viscoelastic_creep.modulus")
    ]
    assert np.all(np.max(np.abs(found.jacobian(found.neutral, lasting)[1][:, 0]), axis=1) > 0)
    once = found._run_sweep(found.reduced_dataset, found.neutral, lasting, False)[1]
    assert not np.any(once)


def test_a_form_explains_what_it_relieves_the_lab_s_own_numbers_of():
    """A load cell that reads a hundredth too much strains the turns, within what the lab believes."""
    found = build_library_problem(inject_effects(0, np.random.default_rng(5)).case)
    found = dataclasses.replace(
        found, measured=np.stack([1.01 * found.measured[0], np.full(found.n, np.nan)])
    )
    baseline = fit_candidate(found, np.ones(found.n, dtype=bool), (), found.neutral)
    gain = next(form for form in build_candidates(found) if form.id == "force_gain")
    (seen,) = compute_score_directions(found, baseline.noise, baseline.estimate, [gain])
    at = fit_parameters(found, baseline.noise, get_free_indices(found, (gain,)), baseline.estimate.values)
    assert seen.chi2_reduction == pytest.approx(baseline.estimate.cost - at.cost, rel=0.1)
    # Able to fail: of the residual alone it would explain another part.
    free = seen.unit_vectors[:, : baseline.estimate.residual.size] @ baseline.estimate.residual
    assert abs(float(free @ free) - (baseline.estimate.cost - at.cost)) > 0.2 * seen.chi2_reduction
