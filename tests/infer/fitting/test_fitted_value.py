"""Digits of estimates with and without a standard deviation."""

import math

import pytest

from pamjax.infer.fitting.report import format_fitted_value
from pamjax.infer.fitting.result import Estimate
from pamjax.parameter import Meaning

LENGTH = Meaning("m", "mm", 0.1, 0.3, "linear", "thread", "test")
TURNS = Meaning("1", "1", 0.05, 200.0, "linear", "turns", "test")


@pytest.mark.parametrize(
    ("estimate", "text"),
    [
        (Estimate(0.21424567, 1e-4, 0.214, 5e-4, LENGTH, at_limit=False), "214.25 ± 0.10 mm"),
        (Estimate(0.21554567, None, 0.214, 5e-4, LENGTH, at_limit=True), "215.55 mm"),
        (Estimate(0.29999123, None, 0.2, math.inf, LENGTH, at_limit=True), "300 mm"),
        (Estimate(199.98765, None, 1.2, math.inf, TURNS, at_limit=True), "200"),
        (Estimate(1.0912345, None, 1.09, 0.005, TURNS, at_limit=True), "1.0912"),
    ],
)
def test_value_at_a_limit_has_the_digits_of_its_prior_or_three(estimate, text):
    assert format_fitted_value(estimate) == text
