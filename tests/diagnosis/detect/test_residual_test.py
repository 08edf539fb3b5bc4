"""A residual counts as unexplained only if it is beyond the noise and beyond the errors of equations."""

import pytest

from pamjax.diagnosis.detect.residual_test import is_residual_large, is_residual_significant
from pamjax.diagnosis.detect.significance import Significance
from pamjax.diagnosis.settings import DEFAULT_SETTINGS


@pytest.mark.parametrize(("square", "left"), [(1.05, False), (1.5, True)])
def test_misfit_below_the_form_error_is_not_unexplained(square, left):
    faint = Significance(p_value=1e-9, largest_deviation=8.0, direction_count=100, mean_square=square)
    assert is_residual_significant(faint, faint, DEFAULT_SETTINGS) is left


@pytest.mark.parametrize("p_value", [0.1, 1e-9])
def test_large_misfit_within_noise_is_not_significant(p_value):
    mismatch = Significance(p_value=1e-300, largest_deviation=50.0, direction_count=100, mean_square=5.3)
    rest = Significance(p_value=p_value, largest_deviation=4.0, direction_count=100, mean_square=1.3)
    assert is_residual_large(mismatch, rest, DEFAULT_SETTINGS)
    assert is_residual_significant(mismatch, rest, DEFAULT_SETTINGS) is (p_value < 0.01)
