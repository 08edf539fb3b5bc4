"""Blocks to hold out: complete blocks inside the range of a recording."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax.benchmark.setups import build_reference_setup
from pamjax.diagnosis.crossval.held_out_errors import build_held_out_mask, compute_held_out_errors
from pamjax.diagnosis.form_errors.prediction import ModelPrediction
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


def test_larger_error_than_without_mechanisms_and_than_expected_is_an_increase():
    result = diagnosis()
    errors = result.held_out_errors
    baseline = errors.baseline_rmse["force"]
    for model, expected, channels in (
        (1.1 * baseline, 0.5 * baseline, ["force"]),
        (0.9 * baseline, 0.5 * baseline, []),
        (1.1 * baseline, 1.2 * baseline, []),
    ):
        changed = replace(
            errors,
            model_rmse=errors.model_rmse | {"force": model},
            expected_rmse=errors.expected_rmse | {"force": expected},
        )
        assert changed.increased_channels == channels
        text = str(replace(result, held_out_errors=changed))
        assert ("the mechanisms increase the held-out error" in text) == bool(channels)
