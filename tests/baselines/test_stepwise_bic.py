"""Stepwise selection by BIC with independent noise: it selects effects, and correlated noise too."""

import numpy as np
import pytest

from pamjax.baselines.stepwise_bic import compute_bic, select_by_bic
from tests.diagnosis.bank import BankRecording, diagnose_bank

WRONG_ZERO = BankRecording(1, only="force_offset", smallest=12.0, largest=12.0, correlation=0.0)


def test_bic_accepts_a_parameter_only_for_a_sufficient_gain():
    n = 1000
    price = n * (1 - np.exp(-np.log(n) / n))
    assert compute_bic(n - 0.9 * price, n, 3) > compute_bic(n, n, 2)
    assert compute_bic(n - 1.1 * price, n, 3) < compute_bic(n, n, 2)


@pytest.mark.slow
def test_a_large_effect_in_white_noise_is_selected_and_predicted():
    diagnosis = diagnose_bank(WRONG_ZERO)
    held_out, measured = diagnosis.held_out_errors.held_out_mask, diagnosis.problem.measured[0]
    selection = select_by_bic(diagnosis.problem, ~held_out)
    assert selection.ids[0] == "force_offset"
    force_sd = diagnosis.problem.case.muscle_toml.sensors.force
    assert force_sd is not None
    assert np.sqrt(np.nanmean((measured - selection.force)[held_out] ** 2)) < 1.5 * force_sd


@pytest.mark.slow
def test_correlated_noise_is_mistaken_for_mechanisms_where_a_diagnosis_names_none():
    diagnosis = diagnose_bank(BankRecording(seed=0, correlation=0.9))
    assert diagnosis.named_mechanisms == ()
    assert select_by_bic(diagnosis.problem, ~diagnosis.held_out_errors.held_out_mask).ids != ()
