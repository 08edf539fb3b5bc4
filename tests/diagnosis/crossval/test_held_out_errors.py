"""Blocks to hold out: complete blocks inside the range of a recording."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax.benchmark.setups import build_reference_setup
from pamjax.diagnosis.crossval.held_out_errors import build_held_out_mask, compute_held_out_errors
from pamjax.diagnosis.form_errors.prediction import ModelPrediction
from pamjax.diagnosis.settings import DEFAULT_SETTINGS
from pamjax.infer.problem.rms import compute_rms
from pamjax.records.blocks import Blocks, find_blocks
from tests.agreement import ROUNDING, agree
from tests.view.made_up import diagnosis


@pytest.mark.parametrize(("many", "out"), [(1, 0), (2, 0), (3, 1), (4, 1), (6, 1), (10, 2)])
def test_complete_blocks_inside_the_range_are_held_out(many, out):
    blocks = Blocks(np.repeat(np.arange(many), 7), tuple(f"b{k}" for k in range(many)), "isobars")
    rows = build_held_out_mask(blocks)
    labels = set(blocks.label[rows].tolist())
    assert len(labels) == out
    assert not labels & {0, many - 1}
    assert rows.sum() == 7 * out


def test_simulated_protocol_has_blocks_to_hold_out():
    assert build_held_out_mask(find_blocks(build_reference_setup().plan)).any()


def test_expected_error_has_noise_and_the_uncertainty_of_the_prediction():
    result, sd = diagnosis(), 3.0
    problem, rows = result.problem, result.held_out_errors.held_out_mask
    noise = result.model.noise.by_channel[0].sd
    off = problem.measured + np.array([[20.0], [0.0]])
    errors = compute_held_out_errors(
        problem, result.blocks, rows, result.baseline, result.model,
        ModelPrediction(off, np.full_like(off, sd), has_form_errors=False),
    )  # fmt: skip
    expected = np.sqrt(compute_rms(noise[rows]) ** 2 + sd**2)
    agree(errors.expected_rmse["force"], expected, ROUNDING)
    agree(errors.model_rmse["force"], 20.0, ROUNDING)
    agree(errors.largest_error_ratio, 20.0 / expected, ROUNDING)


@pytest.mark.parametrize(
    ("force", "diameter", "is_increased"),
    # The second diameter is larger by chance, beside a force that is much better.
    [(1.1, 1.0, True), (0.9, 1.0, False), (0.5, 1.01, False), (0.99, 1.5, True)],
)
def test_mechanisms_that_increase_the_error_are_reported(force, diameter, is_increased):
    result = diagnosis()
    expected = {"force": 2.0, "diameter": 1e-4}
    baseline = {"force": 6.0, "diameter": 2e-4}
    errors = replace(
        result.held_out_errors,
        expected_rmse=expected,
        baseline_rmse=baseline,
        model_rmse={"force": force * baseline["force"], "diameter": diameter * baseline["diameter"]},
    )
    assert errors.is_increased(DEFAULT_SETTINGS) == is_increased
    text = str(replace(result, held_out_errors=errors))
    assert ("the mechanisms increase the held-out error" in text) == is_increased


@pytest.mark.parametrize(("share", "text"), [(0.12, "12% of"), (0.002, "below 1% of")])
def test_a_small_unexplained_share_is_not_zero(share, text):
    result = replace(diagnosis(unexplained=True), residual_share=share)
    assert f"unexplained: {text} the misfit" in str(result)
