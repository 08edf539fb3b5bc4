"""What a model is forgiven of the noise that it makes itself."""

from types import SimpleNamespace
from typing import Any, cast

import pytest

from pamjax.diagnosis.refit.candidate_fit import CandidateFit


def model(cost, passed, trust=1.0):
    at = SimpleNamespace(cost=cost, free=(0, 1))
    white = SimpleNamespace(size=1000, weight=trust)
    return CandidateFit((), cast(Any, white), cast(Any, at), passed)


@pytest.mark.parametrize(
    ("cost", "passed", "fair"),
    [
        (1100.0, 60.0, 1040.0),  # it is there, and is no misfit
        (1100.0, 300.0, 998.0),  # no more than is there
        (980.0, 60.0, 980.0),  # nothing is there
        (980.0, -60.0, 1040.0),  # what a lag averages is no merit
    ],
)
def test_noise_of_a_models_own_is_forgiven_as_far_as_it_is_there(cost, passed, fair):
    assert model(cost, passed).corrected_chi2 == pytest.approx(fair)


def test_of_a_model_that_is_weighed_by_what_it_leaves_noise_is_less():
    assert model(400.0, 1000.0, trust=0.5).corrected_chi2 == pytest.approx(0.25 * 1000 - 2)
