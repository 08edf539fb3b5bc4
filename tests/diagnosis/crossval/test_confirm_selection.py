"""Held-out blocks: what a diagnosis uses of them, and what it reports where they contradict a mechanism."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax import diagnose
from pamjax.diagnosis.crossval.block_cross_validation import BlockCrossValidation
from pamjax.diagnosis.crossval.confirm_selection import format_dropped_mechanisms
from tests.agreement import SOLVED, agree
from tests.diagnosis.bank import (
    BankRecording,
    check_identified,
    diagnose_bank,
    list_missing,
    replace_recording,
    simulate_bank,
)

pytestmark = pytest.mark.slow

#: Largest probability of a mechanism beside an unexplained misfit.
MAX_PROBABILITY_BESIDE_MISFIT = 0.75

#: Smallest predicted fraction of a mechanism that is in the recording.
MIN_TRUE_FRACTION = 0.9

RUBBER = BankRecording(1, seed=5, only="bladder_elasticity", smallest=12.0, largest=12.0)
#: Weaker rubber beside a step of the force zero.
RUBBER_AND_STEP = replace(RUBBER, smallest=5.0, largest=5.0, unmodelled="zero_step")


def test_held_out_values_change_neither_names_nor_predictions_but_their_certainty():
    diagnosis, case = diagnose_bank(RUBBER), simulate_bank(RUBBER).case
    held_out = diagnosis.held_out_errors.held_out_mask
    changed = diagnose(replace_recording(case, force=case.recording.force + np.where(held_out, 15.0, 0.0)))
    assert 0 < held_out.sum() < held_out.size
    assert [m.id for m in changed.named_mechanisms] == [m.id for m in diagnosis.named_mechanisms]
    agree(
        changed.held_out_errors.baseline_prediction, diagnosis.held_out_errors.baseline_prediction, to=SOLVED
    )
    agree(changed.held_out_errors.model_prediction, diagnosis.held_out_errors.model_prediction, to=SOLVED)
    # The values themselves are compared with the predictions, and the final fit uses them.
    assert changed.held_out_errors.model_rmse["force"] > 10.0
    assert changed.held_out_errors.largest_error_ratio > 3.0
    assert diagnosis.held_out_errors.largest_error_ratio < 1.2
    # Prediction and recording disagree: a part is unexplained, and half of the certainty remains.
    assert changed.unexplained
    assert not diagnosis.unexplained
    assert all(
        after.probability == pytest.approx(0.5 + 0.5 * (before.probability - 0.5))
        for before, after in zip(diagnosis.named_mechanisms, changed.named_mechanisms, strict=True)
    )
    assert "times the expected one" in str(changed)
    assert "times the expected one" not in str(diagnosis)
    assert np.nanmax(np.abs(changed.model.estimate.values - diagnosis.model.estimate.values)) > 0


def test_a_named_mechanism_predicts_held_out_blocks_to_the_noise():
    errors = diagnose_bank(RUBBER).held_out_errors
    noise = diagnose_bank(BankRecording()).held_out_errors.baseline_rmse["force"]
    assert errors.baseline_rmse["force"] > 5 * noise
    assert errors.model_rmse["force"] < 1.2 * noise


def test_whole_isobars_inside_the_range_are_held_out():
    diagnosis = diagnose_bank(RUBBER)
    labels, held_out = diagnosis.blocks.label, diagnosis.held_out_errors.held_out_mask
    assert diagnosis.blocks.kind == "isobars"
    assert {k for k in range(5) if np.any(held_out[labels == k])} == {2}
    assert np.all(held_out[labels == 2])


def test_a_mechanism_beside_an_unexplained_effect_has_half_of_its_certainty():
    diagnosis = diagnose_bank(RUBBER_AND_STEP)
    assert diagnosis.unexplained
    assert list_missing(diagnosis, ["bladder_elasticity"]) == []
    assert all(m.probability <= MAX_PROBABILITY_BESIDE_MISFIT for m in diagnosis.named_mechanisms)
    # Without the other effect the mechanism is certain.
    assert diagnose_bank(RUBBER).named_mechanisms[0].probability > MAX_PROBABILITY_BESIDE_MISFIT


def test_misfit_of_other_physics_does_not_reduce_the_fraction():
    diagnosis = diagnose_bank(RUBBER_AND_STEP)
    cross_validation = BlockCrossValidation.from_blocks(
        diagnosis.problem,
        diagnosis.blocks,
        ~diagnosis.held_out_errors.held_out_mask,
        diagnosis.selection.model,
    )
    # The step of the zero is in no mechanism, so that a part of the left-out misfit remains.
    assert cross_validation.explained_fraction < MIN_TRUE_FRACTION
    assert cross_validation.predicted_fraction_by_mechanism["bladder_elasticity"] > MIN_TRUE_FRACTION


def test_a_few_isobars_are_divided_into_cycles():
    diagnosis = diagnose_bank(replace(RUBBER, pressures=(0, 1)))
    assert diagnosis.blocks.kind == "cycles"
    assert 0 < diagnosis.held_out_errors.held_out_mask.sum() < 0.5 * diagnosis.problem.n


def test_two_blocks_are_too_few_to_hold_one_out():
    friction = BankRecording(1, only="braid_friction", smallest=12.0, largest=12.0, pressures=(4,))
    diagnosis = diagnose_bank(friction)
    assert not diagnosis.held_out_errors.held_out_mask.any()
    assert diagnosis.held_out_errors.model_rmse == {}
    check_identified(diagnosis, ["braid_friction"])


def test_a_block_without_readings_is_ignored():
    case = simulate_bank(RUBBER).case
    lowest = diagnose_bank(RUBBER).blocks.label == 0
    blank = {c: np.where(lowest, np.nan, getattr(case.recording, c)) for c in ("force", "diameter")}
    check_identified(diagnose(replace_recording(case, **blank)), ["bladder_elasticity"])


def test_dropped_mechanisms_are_in_a_note():
    before = diagnose_bank(RUBBER).selection
    assert format_dropped_mechanisms(before, before) == []
    assert format_dropped_mechanisms(before, replace(before, named_mechanisms=())) == [
        "`bladder_elasticity` is not reported: after cross-validation its probability is too low."
    ]
