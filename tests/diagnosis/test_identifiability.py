"""What a baseline's refit leaves open is told, and what it settles is not."""

from types import SimpleNamespace

import numpy as np

from pamjax.diagnosis.identifiability import (
    format_strained_parameters,
    format_unidentified_combinations,
    format_untestable_mechanisms,
)

NAMES = ("muscle.thread_length", "muscle.turns")


def refitted(jacobian):
    found = SimpleNamespace(names=NAMES, prior_sd=np.array([1e-3, 5e-3]), start=np.array([0.25, 1.1]))
    at = SimpleNamespace(free=(0, 1), jacobian=np.array(jacobian), scale=np.ones(2))
    return found, SimpleNamespace(estimate=at)


def test_a_number_that_moves_nothing_is_told():
    (said,) = format_unidentified_combinations(*refitted([[1e5, 0.0]]))
    assert "little about `muscle.turns`" in said


def test_two_numbers_that_undo_each_other_are_told_together():
    # One sample sees only their sum, in steps of what was believed of each.
    (said,) = format_unidentified_combinations(*refitted([[1e5, 2e4]]))
    assert "together" in said
    assert "thread_length" in said
    assert "turns" in said


def test_what_the_recording_settles_is_not_told():
    assert format_unidentified_combinations(*refitted([[1e5, 0.0], [0.0, 2e4]])) == []


def test_a_number_that_was_stopped_on_its_way_is_told():
    low, high = np.array([0.247, 1.085]), np.array([0.253, 1.115])
    found = SimpleNamespace(
        names=NAMES,
        prior_sd=np.array([1e-3, 5e-3]),
        is_baseline=np.array([True, True]),
        low=low,
        high=high,
        is_logarithmic=np.zeros(2, bool),
    )

    def said(*values):
        at = SimpleNamespace(free=(0, 1), values=np.array(values))
        return format_strained_parameters(found, SimpleNamespace(estimate=at))

    (one,) = said(0.25, 1.115 - 1e-9)
    assert one.startswith("`muscle.turns` ended as far")
    (both,) = said(0.247, 1.085)
    assert both.startswith("`muscle.thread_length` and `muscle.turns` ended as far")
    assert said(0.2475, 1.1) == []


def test_what_a_table_was_not_asked_is_told():
    def said(has_time):
        return format_untestable_mechanisms(
            SimpleNamespace(case=SimpleNamespace(recording=SimpleNamespace(has_time=has_time)))
        )

    (one,) = said(False)
    assert "`time`" in one
    assert "friction" in one
    assert said(True) == []
