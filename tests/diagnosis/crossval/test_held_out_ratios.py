"""Mechanisms that increase the error on held-out rows beside an unexplained part."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax import diagnose
from pamjax.diagnosis.crossval.held_out_ratios import (
    compute_held_out_ratios,
    drop_harmful_mechanisms,
    format_harmful_mechanisms,
)
from pamjax.diagnosis.library.library_problem import build_library_problem
from tests.diagnosis.bank import BankRecording, diagnose_bank, replace_recording, simulate_bank

pytestmark = pytest.mark.slow

RUBBER = BankRecording(1, only="bladder_elasticity", smallest=12.0, largest=12.0)


def get_training(diagnosis):
    return ~diagnosis.held_out_errors.held_out_mask


def test_a_true_mechanism_decreases_the_error():
    diagnosis = diagnose_bank(RUBBER)
    ratios = compute_held_out_ratios(
        diagnosis.problem,
        get_training(diagnosis),
        diagnosis.model.mechanisms,
        diagnosis.model.estimate.values,
    )
    assert list(ratios) == ["bladder_elasticity"]
    assert ratios["bladder_elasticity"] < 0.5
    kept = drop_harmful_mechanisms(diagnosis.problem, get_training(diagnosis), diagnosis.selection)
    assert kept is diagnosis.selection


def test_a_mechanism_that_the_held_out_rows_contradict_is_dropped():
    diagnosis, case = diagnose_bank(RUBBER), simulate_bank(RUBBER).case
    training = get_training(diagnosis)
    # The held-out rows have the force of the muscle without rubber.
    alone = diagnosis.held_out_errors.baseline_prediction[0]
    changed = replace_recording(case, force=np.where(training, case.recording.force, alone))
    remaining = drop_harmful_mechanisms(build_library_problem(changed), training, diagnosis.selection)
    assert remaining.named_mechanisms == ()
    assert format_harmful_mechanisms(diagnosis.selection, remaining) == [
        "`bladder_elasticity` is not reported: it increases the error of the held-out rows."
    ]
    # A diagnosis of this recording says so, and reports the misfit as unexplained.
    second = diagnose(changed)
    assert second.named_mechanisms == ()
    assert second.unexplained
    assert "increases the error of the held-out rows" in str(second)


def test_several_mechanisms_are_dropped_in_one_sentence():
    selection = diagnose_bank(RUBBER).selection
    two = replace(
        selection,
        named_mechanisms=tuple(replace(selection.named_mechanisms[0], id=id) for id in ("a", "b")),
    )
    assert format_harmful_mechanisms(two, replace(two, named_mechanisms=())) == [
        "`a` and `b` are not reported: they increase the error of the held-out rows."
    ]
    assert format_harmful_mechanisms(two, two) == []


def test_without_held_out_rows_nothing_is_dropped():
    diagnosis = diagnose_bank(RUBBER)
    everything = np.ones(diagnosis.problem.n, dtype=bool)
    assert drop_harmful_mechanisms(diagnosis.problem, everything, diagnosis.selection) is diagnosis.selection


def test_held_out_rows_without_readings_drop_nothing():
    diagnosis = diagnose_bank(RUBBER)
    training = get_training(diagnosis)
    blank = np.where(training, diagnosis.problem.measured, np.nan)
    problem = replace(diagnosis.problem, measured=blank)
    assert drop_harmful_mechanisms(problem, training, diagnosis.selection) is diagnosis.selection
