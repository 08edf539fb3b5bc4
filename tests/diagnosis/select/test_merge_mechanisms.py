"""Two mechanisms that imitate one are replaced by it, and two that are right stay."""

import numpy as np
import pytest

from pamjax.diagnosis.select.merge_mechanisms import merge_mechanisms
from tests.diagnosis.bank import BankRecording, diagnose_bank
from tests.diagnosis.searches import build_search, fit_ids

pytestmark = pytest.mark.slow

#: A force gain and jammed threads, as in `test_bank.py`.
RECORDING = BankRecording(2, seed=7, smallest=4.0, largest=25.0)


@pytest.fixture(scope="module")
def search():
    return build_search(diagnose_bank(RECORDING).problem)


def test_jammed_threads_replace_rubber_and_a_force_offset(search):
    fit = fit_ids(search, ["pressure_gain", "bladder_elasticity", "force_offset"])
    merged = merge_mechanisms(search, fit)
    assert set(merged.ids) == {"pressure_gain", "braid_locking"}
    # Both explain the recording.
    assert max(fit.excess_chi2, merged.excess_chi2) < 4 * np.sqrt(2 * fit.noise.size)


def test_two_right_mechanisms_stay(search):
    fit = fit_ids(search, ["pressure_gain", "braid_locking"])
    assert merge_mechanisms(search, fit) is fit
