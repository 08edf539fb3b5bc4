"""What a baseline's refit leaves open is told, and what it settles is not."""

from types import SimpleNamespace

import numpy as np

from pamjax.diagnosis.identifiability import strained, unasked, undetermined

NAMES = ("muscle.thread_length", "muscle.turns")


def refitted(jacobian):
    found = SimpleNamespace(names=NAMES, sd=np.array([1e-3, 5e-3]), start=np.array([0.25, 1.1]))
    at = SimpleNamespace(moved=(0, 1), jacobian=np.array(jacobian), scale=np.ones(2))
    return found, SimpleNamespace(at=at)


def test_a_number_that_moves_nothing_is_told():
    (said,) = undetermined(*refitted([[1e5, 0.0]]))
    assert "little about `muscle.turns`" in said


def test_two_numbers_that_undo_each_other_are_told_together():
    # One sample sees only their sum, in steps of what was believed of each.
    (said,) = undetermined(*refitted([[1e5, 2e4]]))
    assert "together" in said
    assert "thread_length" in said
    assert "turns" in said


def test_what_the_recording_settles_is_not_told():
    assert undetermined(*refitted([[1e5, 0.0], [0.0, 2e4]])) == []


def test_a_number_that_was_stopped_on_its_way_is_told():
    low, high = np.array([0.247, 1.085]), np.array([0.253, 1.115])
    found = SimpleNamespace(
        names=NAMES,
        sd=np.array([1e-3, 5e-3]),
        own=np.array([True, True]),
        low=low,
        high=high,
        log=np.zeros(2, bool),
    )

    def said(*values):
        at = SimpleNamespace(moved=(0, 1), values=np.array(values))
        return strained(found, SimpleNamespace(at=at))

    (one,) = said(0.25, 1.115 - 1e-9)
    assert one.startswith("`muscle.turns` ended as far")
    (both,) = said(0.247, 1.085)
    assert both.startswith("`muscle.thread_length` and `muscle.turns` ended as far")
    assert said(0.2475, 1.1) == []


def test_what_a_table_was_not_asked_is_told():
    def said(has_time):
        return unasked(SimpleNamespace(case=SimpleNamespace(recording=SimpleNamespace(has_time=has_time))))

    (one,) = said(False)
    assert "`time`" in one
    assert "friction" in one
    assert said(True) == []
