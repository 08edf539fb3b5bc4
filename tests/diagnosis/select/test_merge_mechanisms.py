"""Two mechanisms that imitate one are replaced by it, and two that are right stay."""

import numpy as np
import pytest

from pamjax.diagnosis.library.candidates import build_candidates
from pamjax.diagnosis.refit.model_fit import fit_model
from pamjax.diagnosis.select.merge_mechanisms import merge_mechanisms
from pamjax.diagnosis.select.neighbour_fits import fit_with_candidate, refit_fully
from pamjax.diagnosis.select.search import MechanismSearch
from pamjax.progress import ignore_progress
from tests.diagnosis.bank import BankRecording, diagnose_bank

pytestmark = pytest.mark.slow

#: A force gain and jammed threads, as in `test_bank.py`.
RECORDING = BankRecording(2, seed=2, smallest=4.0, largest=25.0)


@pytest.fixture(scope="module")
def search():
    problem = diagnose_bank(RECORDING).problem
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


def test_jammed_threads_replace_rubber_and_a_force_offset(search):
    fit = fit_ids(search, ["pressure_gain", "bladder_elasticity", "force_offset"])
    merged = merge_mechanisms(search, fit)
    assert set(merged.ids) == {"pressure_gain", "braid_locking"}
    # Both explain the recording.
    assert max(fit.excess_chi2, merged.excess_chi2) < 3 * np.sqrt(2 * fit.noise.size)


def test_two_right_mechanisms_stay(search):
    fit = fit_ids(search, ["pressure_gain", "braid_locking"])
    assert merge_mechanisms(search, fit) is fit
