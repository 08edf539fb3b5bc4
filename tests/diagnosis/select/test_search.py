"""Tests at the end of a search: which mechanisms stay."""

import numpy as np
import pytest

from pamjax.diagnosis.form_errors.columns import compute_effect
from pamjax.diagnosis.library.candidates import build_candidates
from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.refit.model_fit import fit_model
from pamjax.diagnosis.select.neighbour_fits import fit_with_candidate, fit_without_mechanism, refit_fully
from pamjax.diagnosis.select.search import MechanismSearch, prune_mechanisms
from pamjax.progress import ignore_progress
from tests.diagnosis.bank import BankRecording, diagnose_bank, replace_recording, simulate_bank

pytestmark = pytest.mark.slow

#: Largest difference of the rubber's force from its equation, as a share of its effect.
SHARE = 0.3

#: Friction, N: its rms is below the standard deviation of the force noise.
FRICTION = 2.0


def build_search(friction):
    """Return a search in a recording with rubber of another form, and a small friction of the braid."""
    definition = BankRecording(1, only="bladder_elasticity", smallest=25.0, largest=25.0)
    diagnosis, recording = diagnose_bank(definition), simulate_bank(definition).case.recording
    rubber = compute_effect(
        diagnosis.problem, diagnosis.model.estimate.values, diagnosis.model.mechanisms[0]
    )[0]
    x = 2 * (recording.length - recording.length.min()) / np.ptp(recording.length) - 1
    direction = np.sign(np.gradient(recording.length))
    force = recording.force + SHARE * (1.5 * x**2 - 0.5) * rubber + friction * direction
    case = replace_recording(simulate_bank(definition).case, force=force)
    problem = build_library_problem(case)
    rows = np.ones(problem.n, dtype=bool)
    baseline = fit_model(problem, rows, (), problem.neutral)
    return MechanismSearch(problem, rows, baseline, build_candidates(problem), ignore_progress)


def fit_ids(search, ids):
    """Return the model with some mechanisms, added one by one."""
    fit = search.baseline
    for id in ids:
        directions = [s for s in search.score_candidates(fit) if s.candidate.id == id]
        trials = sorted((fit_with_candidate(search.problem, fit, s) for s in directions), key=lambda m: m.bic)
        fit = refit_fully(search.problem, trials[:3])[0]
    return search.refit(fit)


def test_a_small_mechanism_stays_beside_a_large_one_of_another_form():
    search = build_search(FRICTION)
    fit = fit_ids(search, ["bladder_elasticity", "braid_friction"])
    # Without form errors, friction explains too little of what rubber leaves.
    reduced_fit = fit_without_mechanism(search.problem, fit, 1)
    assert not search.is_worthwhile(reduced_fit, fit, may_be_small=True)
    assert set(prune_mechanisms(search, fit, may_be_small=True).ids) == {
        "bladder_elasticity",
        "braid_friction",
    }


def test_a_mechanism_without_an_effect_is_removed():
    search = build_search(0.0)
    fit = fit_ids(search, ["bladder_elasticity", "braid_friction"])
    assert prune_mechanisms(search, fit, may_be_small=True).ids == ("bladder_elasticity",)
