"""Stepwise selection on simulated recordings in which a simple search finds the wrong mechanisms."""

import pytest

from pamjax import DiagnosisSettings, diagnose
from pamjax.benchmark.trial import TrialTask, draw_ground_truth
from tests.diagnosis.bank import check_identified

pytestmark = pytest.mark.slow


def test_a_pair_replaces_one_mechanism_that_imitates_both():
    ground_truth = draw_ground_truth(TrialTask("all", "triple", 0.0, 3, seed=22))
    check_identified(diagnose(ground_truth.case, method="stepwise"), ground_truth.effect_ids)
    # Negative control: without the exchange of pairs the imitation stays.
    settings = DiagnosisSettings(pair_swap_rounds=0)
    without_pairs = diagnose(ground_truth.case, settings=settings, method="stepwise")
    with pytest.raises(AssertionError):
        check_identified(without_pairs, ground_truth.effect_ids)


def test_effects_that_are_small_beside_a_large_one_are_kept_if_they_leave_only_noise():
    ground_truth = draw_ground_truth(TrialTask("all", "triple", 0.0, 1, seed=6))
    assert min(ground_truth.effect_sizes) < 0.25 * max(ground_truth.effect_sizes)
    check_identified(diagnose(ground_truth.case, method="stepwise"), ground_truth.effect_ids)
    # Negative control: an effect below the share of the largest is dropped, and no pair restores it.
    settings = DiagnosisSettings(min_small_rms_share=1.0, pair_swap_rounds=0)
    without_small = diagnose(ground_truth.case, settings=settings, method="stepwise")
    with pytest.raises(AssertionError):
        check_identified(without_small, ground_truth.effect_ids)
