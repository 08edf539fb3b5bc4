"""The words for how well a recording determines a parameter."""

import math

import pytest

from pamjax.infer.fitting.determination import describe_sd_ratio


@pytest.mark.parametrize(
    ("sd_ratio", "text"),
    [
        (0.0, "determined by the data"),
        (0.5, "determined by the data"),
        (0.51, "partly determined by the data"),
        (0.95, "partly determined by the data"),
        (0.96, "not determined by the data (posterior equals prior)"),
        (math.nan, "not determined by the data (posterior equals prior)"),
    ],
)
def test_each_sd_ratio_has_one_of_three_cases(sd_ratio, text):
    assert describe_sd_ratio(sd_ratio) == text


def test_shifted_posterior_does_not_equal_its_prior():
    assert describe_sd_ratio(0.97, 0.7) == "not determined: sd hardly changed by the data"
    assert describe_sd_ratio(0.97, -0.1) == "not determined by the data (posterior equals prior)"
