"""Digits of estimates with and without a standard deviation."""

import math
from types import SimpleNamespace

import pytest

from pamjax.infer.fitting.report import (
    describe_noise_ratio,
    format_fitted_value,
    list_outliers_and_warnings,
)
from pamjax.infer.fitting.result import Estimate
from pamjax.infer.noise.sensor_noise import ChannelNoise
from pamjax.parameter import Meaning
from pamjax.records.recording import Outlier
from pamjax.units import format_estimate

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


@pytest.mark.parametrize(
    ("value", "sd", "unit", "text"),
    [
        (3704472114.0, 3232556452.0, "Pa*s/m^3", "(3.7 ± 3.2)e9 Pa*s/m^3"),
        (1.2e-5, 3.4e-6, "1", "(1.20 ± 0.34)e-5"),
        (5123.0, 1234.0, "N", "5100 ± 1200 N"),
        (0.0, 0.05, "1", "0.000 ± 0.050"),
        (0.0, 0.0, "N", "0 N"),
        (120e3, None, "kPa", "120 kPa"),
        (1.0, math.nan, "N", "1 N"),
    ],
)
def test_value_has_the_digits_of_its_sd(value, sd, unit, text):
    assert format_estimate(value, sd, unit) == text


def test_ratio_of_misfit_and_noise_agrees_with_both_numbers():
    noise = ChannelNoise(0.309e-3, True, 3.5, 1.0, 0.0, 48)
    assert describe_noise_ratio(2.82e-3, noise) == (
        "9.1 times the noise (rms of residual over noise, row by row: 3.5)"
    )
    assert describe_noise_ratio(1.1e-3, noise) == "3.6 times the noise"


def test_outlier_is_listed_once():
    outlier = Outlier(7, "force", 9e3, "N", "it is alone")
    case = SimpleNamespace(warnings=(f"{outlier}.", "other"), recording=SimpleNamespace(outliers=(outlier,)))
    assert list(list_outliers_and_warnings(case)) == [f"note: {outlier}.", "note: other"]  # type: ignore[arg-type]
    case.warnings = ()
    assert list(list_outliers_and_warnings(case)) == [str(outlier)]  # type: ignore[arg-type]
