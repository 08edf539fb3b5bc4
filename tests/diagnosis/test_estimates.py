"""Texts of a diagnosis for its parameters."""

import pytest

from pamjax.diagnosis.estimates import build_parameter_estimate
from pamjax.diagnosis.summary import format_named_estimate
from tests.diagnosis.bank import build_plan_problem
from tests.diagnosis.plain_fits import build_fit


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("muscle.turns", 1.09, False),
        ("muscle.turns", 1.10199, True),  # a limit of this recording, 3 sd from the stated value
        ("muscle.turns", 1.07801, True),
        ("braid_friction.coefficient", 1e-4, False),  # without friction it is not at a limit
        ("braid_friction.coefficient", 4.999, True),
        ("viscoelastic_creep.time_long", 10.001, True),
        ("viscoelastic_creep.time_long", 15.0, False),  # on a linear scale it would be at the lower limit
    ],
)
def test_parameter_at_its_limit_is_marked(name, value, expected):
    problem = build_plan_problem()
    k = problem.index(name)
    values = problem.neutral.copy()
    values[k] = value
    estimate = build_parameter_estimate(problem, build_fit(values, [k]), k)
    assert format_named_estimate(name, estimate).endswith(", at its limit") is expected
