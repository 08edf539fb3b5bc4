"""Stepwise selection on a simulated recording with three mechanisms."""

import pytest

from pamjax import diagnose
from pamjax.benchmark.trial import TrialTask, draw_ground_truth
from tests.diagnosis.bank import check_identified

pytestmark = pytest.mark.slow


def test_three_mechanisms_of_a_random_muscle_are_named():
    ground_truth = draw_ground_truth(TrialTask("all", "triple", 0.0, 3, seed=22))
    check_identified(diagnose(ground_truth.case, method="stepwise"), ground_truth.effect_ids)
