"""Share of the effect of a mechanism that left-out blocks confirm."""

import pytest

from pamjax.diagnosis.crossval.explained_fraction import BlockCrossValidation, _compute_predicted_share
from tests.diagnosis.bank import BankRecording, diagnose_bank

#: Smallest predicted share of a mechanism that is in the recording.
MIN_TRUE_SHARE = 0.9


@pytest.mark.parametrize(
    ("left_out", "fitted", "total", "share"),
    [
        (80.0, 100.0, 100.0, 0.8),
        (120.0, 100.0, 100.0, 1.0),
        (-5.0, 100.0, 100.0, 0.0),
        # The blocks that the others inform have less than 5 % of the effect: no test.
        (0.0, 4.0, 100.0, 1.0),
        (-1.0, 0.0, 0.0, 0.0),
        (5.0, -1.0, -1.0, 0.0),
    ],
)
def test_the_share_is_the_ratio_of_both_reductions(left_out, fitted, total, share):
    assert _compute_predicted_share(left_out, fitted, total, 0.05) == pytest.approx(share)


@pytest.mark.slow
def test_misfit_of_other_physics_does_not_reduce_the_share():
    rubber = BankRecording(1, only="bladder_elasticity", smallest=5.0, largest=5.0, unmodelled="zero_step")
    diagnosis = diagnose_bank(rubber)
    cross_validation = BlockCrossValidation.from_blocks(
        diagnosis.problem, diagnosis.blocks, ~diagnosis.gain.held_out, diagnosis.selection.model
    )
    # The step of the zero is in no mechanism, so that a part of the left-out misfit remains.
    assert cross_validation.explained_fraction < MIN_TRUE_SHARE
    assert cross_validation.predicted_share_by_mechanism["bladder_elasticity"] > MIN_TRUE_SHARE
