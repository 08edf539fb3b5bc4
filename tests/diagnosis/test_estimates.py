"""Texts of a diagnosis for its parameters."""

import math

import pytest

from pamjax.diagnosis.estimates import build_parameter_estimate, compute_parameter_shifts
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
    assert format_named_estimate(name, estimate).endswith(" limit)") is expected
    assert estimate.at_limit is expected
    # The prior, or the curvature beyond a limit, is no standard deviation of a value at the limit.
    assert math.isnan(estimate.sd) is expected


def test_limit_is_named():
    problem = build_plan_problem()
    k = problem.index("muscle.turns")
    for value, text in ((1.10199, "1.102 (at its upper limit)"), (1.07801, "1.078 (at its lower limit)")):
        values = problem.neutral.copy()
        values[k] = value
        assert str(build_parameter_estimate(problem, build_fit(values, [k]), k)) == text


@pytest.mark.parametrize(("value", "has_shift"), [(1.095, True), (1.10199, False)])
def test_shift_from_a_limit_is_not_in_sd(value, has_shift):
    problem = build_plan_problem()
    k = problem.index("muscle.turns")
    before, after = problem.neutral.copy(), problem.neutral.copy()
    before[k], after[k] = value, 1.09
    shifts = compute_parameter_shifts(problem, build_fit(before, [k]), build_fit(after, [k]))
    assert math.isfinite(shifts["muscle.turns"].shift_in_sd) is has_shift
    assert math.isinf(shifts["muscle.turns"].order) is not has_shift
