"""A residual counts as unexplained only if it is beyond the noise and beyond the errors of equations."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax.diagnosis.detect.locate import locate_residual
from pamjax.diagnosis.detect.residual_test import (
    is_residual_large,
    is_residual_significant,
    run_baseline_test,
    run_residual_test,
)
from pamjax.diagnosis.detect.significance import ResidualTest
from pamjax.diagnosis.library.candidates import build_candidates
from pamjax.diagnosis.library.library_problem import build_library_problem
from pamjax.diagnosis.refit.model_fit import fit_model
from pamjax.diagnosis.settings import DEFAULT_SETTINGS
from pamjax.records.reading.muscle_toml import Sensors
from tests.diagnosis.bank import BankRecording, simulate_bank


@pytest.mark.parametrize(("square", "left"), [(1.05, False), (1.5, True)])
def test_misfit_below_the_form_error_is_not_unexplained(square, left):
    faint = ResidualTest(p_value=1e-9, largest_deviation=8.0, direction_count=100, mean_square=square)
    assert is_residual_significant(faint, faint, DEFAULT_SETTINGS) is left


@pytest.mark.parametrize("p_value", [0.1, 1e-9])
def test_large_misfit_within_noise_is_not_significant(p_value):
    baseline_test = ResidualTest(p_value=1e-300, largest_deviation=50.0, direction_count=100, mean_square=5.3)
    rest = ResidualTest(p_value=p_value, largest_deviation=4.0, direction_count=100, mean_square=1.3)
    assert is_residual_large(baseline_test, rest, DEFAULT_SETTINGS)
    assert is_residual_significant(baseline_test, rest, DEFAULT_SETTINGS) is (p_value < 0.01)


@pytest.mark.slow
@pytest.mark.parametrize("is_stated", [True, False])
def test_a_large_residual_is_unexplained_with_and_without_stated_noise(is_stated):
    """The noise of sensors that are not stated comes from neighbouring samples, which contain no misfit."""
    case = simulate_bank(BankRecording(seed=0, unmodelled="obstacle")).case
    if not is_stated:
        case = replace(case, muscle_toml=replace(case.muscle_toml, sensors=Sensors()))
    problem = build_library_problem(case)
    rows = np.ones(problem.n, dtype=bool)
    baseline = fit_model(problem, rows, (), problem.neutral)
    drift = next(candidate for candidate in build_candidates(problem) if candidate.id == "force_drift")
    model = fit_model(problem, rows, [drift], problem.neutral)
    baseline_test = run_baseline_test(problem, problem.neutral)
    residual_test = run_residual_test(problem, model)
    assert residual_test.mean_square > 2
    assert is_residual_significant(baseline_test, residual_test, DEFAULT_SETTINGS)
    # The sentences state from which model the measurement deviates.
    assert all("the baseline" in region.description for region in locate_residual(problem, baseline))
    assert all(
        "the model with the named mechanisms" in region.description
        for region in locate_residual(problem, model)
    )
