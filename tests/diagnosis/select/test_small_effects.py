"""Small effects may not move the parameters of the baseline far from their stated values."""

import numpy as np
import pytest

from pamjax.diagnosis.select.small_effects import is_prior_consistent
from tests.diagnosis.bank import build_plan_problem
from tests.diagnosis.plain_fits import build_fit


@pytest.mark.parametrize(("deviations", "consistent"), [((2.0, 1.0), True), ((2.7, 2.0), False)])
def test_values_that_are_improbable_together_are_not_consistent_with_the_priors(deviations, consistent):
    """χ² of two standard normal variables: 5 has a p-value of 0.08, and 11.3 a p-value of 0.004."""
    problem = build_plan_problem()
    values, stated = problem.start.copy(), np.flatnonzero(problem.is_baseline)
    values[stated] += np.array(deviations) * problem.prior_sd[stated]
    assert is_prior_consistent(problem, build_fit(values)) is consistent
