"""Parameters that the refit of the baseline does not determine are reported."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pamjax.diagnosis.library.candidates import Candidate
from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.notes import (
    describe_contradicted_values,
    describe_contradiction,
    format_asymmetry,
    format_few_rows,
    format_parameters_at_limit,
    format_unidentified_combinations,
    format_untestable_mechanisms,
)
from tests.diagnosis.bank import build_plan_problem
from tests.diagnosis.plain_fits import build_fit

NAMES = ("muscle.thread_length", "muscle.turns")


def get_free():
    return [build_plan_problem().index(name) for name in NAMES]


def list_unidentified(jacobian, values=None):
    """Return the notes of a refit whose whitened samples have these derivatives by length and turns."""
    problem, jacobian = build_plan_problem(), np.array(jacobian)
    values = problem.start if values is None else values
    fit = build_fit(values, get_free(), residual=np.zeros(len(jacobian)), jacobian=jacobian)
    return format_unidentified_combinations(problem, fit)


@pytest.mark.parametrize("by_turns", [0.0, 100.0])
def test_parameter_that_its_prior_determines_better_is_reported(by_turns):
    """With 100 per turn, one standard sample has an sd of 0.01; the prior has 0.004."""
    (note,) = list_unidentified([[1e5, 0.0], [0.0, by_turns]])
    assert "reduces the sd of `muscle.turns` by less than half" in note


def test_shifted_estimate_does_not_depend_mostly_on_its_prior():
    problem, (_, turns) = build_plan_problem(), get_free()
    for shift_in_sd, count in ((0.5, 1), (1.5, 0)):
        values = problem.start.copy()
        values[turns] += shift_in_sd * problem.prior_sd[turns]
        assert len(list_unidentified([[1e5, 0.0], [0.0, 0.0]], values)) == count


def test_compensating_parameters_are_reported_together():
    # One sample determines only their sum, in units of their prior sd.
    (note,) = list_unidentified([[1e5, 1e4]])
    assert "only in combination" in note
    assert "thread_length" in note
    assert "turns" in note


def test_determined_parameter_is_not_reported():
    assert list_unidentified([[1e5, 0.0], [0.0, 2e4]]) == []


def test_stated_value_at_its_limit_is_named_with_the_stated_value():
    problem, free = build_plan_problem(), get_free()
    values = problem.neutral.copy()
    values[free] = 0.2512, problem.high[free[1]] - 1e-9
    (sentence,) = describe_contradicted_values(problem, build_fit(values, free))
    assert sentence.startswith("`muscle.turns` is 1.1")
    assert "sd from the stated value (1.09" in sentence
    values[free] = problem.start[free]
    assert describe_contradicted_values(problem, build_fit(values, free)) == []


def test_parameter_at_its_limit_is_reported():
    problem, free = build_plan_problem(), get_free()

    def list_strained(*values):
        all_values = problem.neutral.copy()
        all_values[free] = values
        return format_parameters_at_limit(problem, build_fit(all_values, free))

    (length_low, turns_low), (_, turns_high) = problem.low[free], problem.high[free]
    (single,) = list_strained(0.2512, turns_high - 1e-9)
    assert single.startswith("`muscle.turns` reached its limit (3 sd")
    assert single.endswith("its stated sd is too small.")
    (both,) = list_strained(length_low, turns_low)
    assert both.startswith("`muscle.thread_length` and `muscle.turns` reached their limits (3 sd")
    assert both.endswith("their stated sd are too small.")
    assert list_strained(0.2510, 1.085) == []


@pytest.mark.parametrize(("row_count", "is_noted"), [(39, True), (40, False)])
def test_few_rows_for_each_parameter_are_reported(row_count, is_noted):
    problem = SimpleNamespace(measured=np.ones((2, 50)))
    problem.measured[:, row_count:] = np.nan
    fit = SimpleNamespace(mechanisms=("friction",), estimate=SimpleNamespace(free=(0, 1, 2, 3)))
    notes = format_few_rows(problem, fit)  # type: ignore[arg-type]
    assert len(notes) == is_noted
    assert all("4 estimated parameters, and the recording only 39 rows" in note for note in notes)
    fit.mechanisms = ()
    assert format_few_rows(problem, fit) == []  # type: ignore[arg-type]


def test_mechanisms_that_a_table_cannot_test_are_reported():
    problem = build_plan_problem()
    recording = replace(problem.case.recording, time=None, cycle=None)
    table = build_library_problem(replace(problem.case, recording=recording))
    (note,) = format_untestable_mechanisms(table)
    assert "`time`" in note
    assert "friction" in note
    assert format_untestable_mechanisms(problem) == []


@pytest.mark.parametrize(
    ("name", "offset"),
    [
        ("viscous_damping.asymmetry", Candidate("force_offset", ("force_offset.offset",))),
        ("braid_friction.asymmetry", Candidate("length_offset", ("length_offset.offset",))),
    ],
)
def test_asymmetry_that_a_sensor_error_resembles_is_reported(name, offset):
    problem = build_plan_problem()
    k = problem.index(name)
    values = problem.neutral.copy()
    values[k] = 0.5
    (note,) = format_asymmetry(problem, build_fit(values, [k]))
    assert note.startswith(f"`{name}` is +0.50.")
    assert f"`{offset.id}`" in note
    # An even effect has no such parameter, and beside a named offset nothing is in doubt.
    assert format_asymmetry(problem, build_fit(values, get_free())) == []
    assert format_asymmetry(problem, build_fit(values, [k], mechanisms=(offset,))) == []


def test_contradicted_value_has_the_words_of_a_fit():
    problem, (_, turns) = build_plan_problem(), get_free()
    # As for a thread stiffness, whose limits are wider than three sd.
    problem = replace(
        problem, prior_sd=np.where(np.arange(problem.start.size) == turns, 2e-3, problem.prior_sd)
    )
    values = problem.start.copy()
    values[turns] += 4 * 2e-3
    fit = build_fit(values, get_free())
    (sentence,) = describe_contradicted_values(problem, fit)
    assert "4.0 sd from the stated value (1.0900 ± 0.0020)" in sentence
    assert describe_contradiction(problem, fit, "muscle.turns") == (
        "; prior 1.0900 ± 0.0020, shift +4.0 sd, CONTRADICTS ITS PRIOR"
    )
    assert describe_contradiction(problem, fit, "muscle.thread_length") == ""
