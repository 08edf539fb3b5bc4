"""Small effects may not move the parameters of the baseline far from their stated values."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pamjax.diagnosis.select.small_effects import is_prior_consistent
from pamjax.diagnosis.settings import DEFAULT_SETTINGS


@pytest.mark.parametrize(("values", "consistent"), [((0.2, 1.0), True), ((0.27, 2.0), False)])
def test_values_that_are_improbable_together_are_not_consistent_with_the_priors(values, consistent):
    """χ² of two standard normal variables: 5 has a p-value of 0.08, and 11.3 one of 0.004."""
    problem: Any = SimpleNamespace(
        settings=DEFAULT_SETTINGS,
        is_baseline=np.array([True, True]),
        prior_sd=np.array([0.1, 1.0]),
        start=np.zeros(2),
    )
    fit: Any = SimpleNamespace(estimate=SimpleNamespace(values=np.array(values)))
    assert is_prior_consistent(problem, fit) is consistent
