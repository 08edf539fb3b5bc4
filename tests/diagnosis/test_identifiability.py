"""Parameters that the refit of the baseline does not determine are reported."""

from types import SimpleNamespace

import numpy as np

from pamjax.diagnosis.identifiability import (
    format_strained_parameters,
    format_unidentified_combinations,
    format_untestable_mechanisms,
)
from pamjax.diagnosis.settings import DEFAULT_SETTINGS

NAMES = ("muscle.thread_length", "muscle.turns")


def refit(jacobian):
    found = SimpleNamespace(names=NAMES, prior_sd=np.array([1e-3, 5e-3]), start=np.array([0.25, 1.1]))
    at = SimpleNamespace(free=(0, 1), jacobian=np.array(jacobian), scale=np.ones(2))
    return found, SimpleNamespace(estimate=at)


def test_parameter_without_effect_is_reported():
    (said,) = format_unidentified_combinations(*refit([[1e5, 0.0]]))
    assert "does not determine `muscle.turns`" in said


def test_compensating_parameters_are_reported_together():
    # One sample determines only their sum, in units of their prior sd.
    (said,) = format_unidentified_combinations(*refit([[1e5, 2e4]]))
    assert "only in combination" in said
    assert "thread_length" in said
    assert "turns" in said


def test_determined_parameter_is_not_reported():
    assert format_unidentified_combinations(*refit([[1e5, 0.0], [0.0, 2e4]])) == []


def test_parameter_at_its_limit_is_reported():
    low, high = np.array([0.247, 1.085]), np.array([0.253, 1.115])
    found = SimpleNamespace(
        settings=DEFAULT_SETTINGS,
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
    assert one.startswith("`muscle.turns` reached its limit (3 sd")
    (both,) = said(0.247, 1.085)
    assert both.startswith("`muscle.thread_length` and `muscle.turns` reached their limits (3 sd")
    assert said(0.2475, 1.1) == []


def test_mechanisms_that_a_table_cannot_test_are_reported():
    def said(has_time):
        return format_untestable_mechanisms(
            SimpleNamespace(case=SimpleNamespace(recording=SimpleNamespace(has_time=has_time)))
        )

    (one,) = said(False)
    assert "`time`" in one
    assert "friction" in one
    assert said(True) == []
