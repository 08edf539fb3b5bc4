"""Share of the effect of a mechanism that left-out blocks confirm."""

import numpy as np
import pytest

from pamjax.diagnosis.crossval.block_cross_validation import (
    BlockCrossValidation,
    _compute_left_out_reduction,
    _compute_predicted_fraction,
    _LeftOutBlock,
)
from pamjax.diagnosis.detect.score_test import compute_score_directions
from pamjax.diagnosis.library.candidates import build_candidates
from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.refit.model_fit import fit_model
from pamjax.diagnosis.select.mechanism_refits import fit_with_candidate
from pamjax.records.blocks import find_blocks
from tests.diagnosis.bank import BankRecording, simulate_bank


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
    assert _compute_predicted_fraction(left_out, fitted, total, 0.05) == pytest.approx(share)


@pytest.mark.parametrize(
    ("with_mechanism", "without", "reduction"),
    [
        # Excess of a block, and the part of it that the parameter errors cause.
        ([(0.0, 0.0), (10.0, 0.0)], [(100.0, 0.0), (50.0, 0.0)], 140.0),
        # Three blocks do not determine the parameters: the excess of the last one is no evidence against.
        ([(0.0, 0.0), (2000.0, 1900.0)], [(1500.0, 100.0), (500.0, 5000.0)], 1300.0),
        # It is evidence against, if the errors do not cause it.
        ([(0.0, 0.0), (2000.0, 0.0)], [(1500.0, 100.0), (500.0, 0.0)], 0.0),
    ],
)
def test_expected_excess_is_no_evidence_against_a_mechanism(with_mechanism, without, reduction):
    fits, fits_without = ([_LeftOutBlock(*block) for block in blocks] for blocks in (with_mechanism, without))
    assert _compute_left_out_reduction(fits_without, fits, np.array([True, True])) == reduction
    assert _compute_left_out_reduction(fits_without, fits, np.array([False, False])) == 0.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("unmodelled", "imitator"), [("zero_step", "force_drift"), ("obstacle", "force_offset")]
)
def test_a_wrong_mechanism_has_a_small_share(unmodelled, imitator):
    """Each explains misfit in its own fit. Some others, as a drift for an obstacle, also predict it."""
    case = simulate_bank(BankRecording(unmodelled=unmodelled)).case
    problem = build_library_problem(case)
    rows = np.ones(problem.n, dtype=bool)
    baseline = fit_model(problem, rows, (), problem.neutral)
    candidates = [c for c in build_candidates(problem) if c.id == imitator]
    directions = compute_score_directions(problem, baseline.noise, baseline.estimate, candidates)
    best = max(directions, key=lambda direction: direction.chi2_reduction)
    fit = fit_with_candidate(problem, baseline, best)
    assert fit.estimate.chi2 < 0.8 * baseline.estimate.chi2
    cross_validation = BlockCrossValidation.from_blocks(problem, find_blocks(case.recording), rows, fit)
    assert cross_validation.predicted_fraction_by_mechanism[imitator] < 0.5
