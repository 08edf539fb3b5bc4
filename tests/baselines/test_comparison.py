"""Comparison methods: predictions of a Gaussian process and of formulas on rows that they did not use."""

import dataclasses

import numpy as np
import pytest

from pamjax.baselines.comparison import (
    BASELINE_MODEL,
    GAUSSIAN_PROCESS_MODEL,
    SAROSI_MODEL,
    SELECTED_MODEL,
    compare_models,
    find_extrapolation_rows,
)
from pamjax.baselines.gaussian_process import predict_discrepancy
from tests.diagnosis.bank import BankRecording, diagnose_bank
from tests.view.made_up import diagnosis, lengths


def test_gaussian_process_interpolates_and_returns_to_the_baseline_outside_the_data():
    rng = np.random.default_rng(2)
    x = np.linspace(-2, 6, 400)[:, None]
    residual = np.where(x[:, 0] < 2, 5 * np.sin(2 * x[:, 0]), 0.0) + 0.1 * rng.standard_normal(400)
    training_mask = (x[:, 0] < 2) & (np.abs(x[:, 0]) > 0.2)
    prediction = predict_discrepancy(x, residual, training_mask)
    inside, beyond_it = np.abs(x[:, 0]) <= 0.2, x[:, 0] > 5
    assert np.abs(prediction - 5 * np.sin(2 * x[:, 0]))[inside].max() < 0.3
    assert np.abs(prediction[beyond_it]).max() < 1.0
    # Negative control: without the training rows the prediction is poor.
    assert np.abs(prediction - 5 * np.sin(2 * x[:, 0]))[x[:, 0] > 3].max() > 3


def between_isobars():
    """Return the error of a process on an isobar between four others, and that of the baseline."""
    rng = np.random.default_rng(0)
    level, contraction = np.repeat(np.arange(5), 60), np.tile(np.linspace(0, 1, 60), 5)
    x = np.stack([level + 0.003 * rng.standard_normal(300), contraction], axis=1)
    residual = np.sin(3 * contraction) * np.array([0.3, 1.7, 1.0, 0.4, 1.6])[level]
    residual += 0.03 * rng.standard_normal(300)
    training_mask = level != 2
    prediction = predict_discrepancy((x - x.mean(axis=0)) / x.std(axis=0), residual, training_mask)
    return np.std((prediction - residual)[~training_mask]) / np.std(residual[~training_mask])


def test_gaussian_process_interpolates_between_isobars(monkeypatch):
    assert between_isobars() < 0.15
    # Negative control: with a free length scale, it fits each isobar separately.
    monkeypatch.setattr("pamjax.baselines.gaussian_process.find_widest_gap", lambda values: 0.03)
    assert between_isobars() > 0.25


def test_isotonic_test_has_no_comparison():
    """The formulas predict a force, which an isotonic test does not measure."""
    result = diagnosis()
    result.problem.case = dataclasses.replace(
        result.problem.case,
        recording=dataclasses.replace(result.problem.case.recording, measures_length=True),
    )
    assert compare_models(result) is None


@pytest.mark.slow
def test_mechanisms_extrapolate_better_than_a_gaussian_process_and_both_better_than_the_baseline():
    result = diagnose_bank(BankRecording(1, seed=1, only="bladder_elasticity", smallest=12.0, largest=12.0))
    comparison = compare_models(result)
    held_out, extrapolation = comparison.splits
    assert list(held_out.rmse) == [BASELINE_MODEL, SELECTED_MODEL, SAROSI_MODEL, GAUSSIAN_PROCESS_MODEL]
    noise = comparison.noise_sd["force"]
    between, beyond = ({m: by["force"] for m, by in split.rmse.items()} for split in comparison.splits)
    for force in (between, beyond):
        assert force[SELECTED_MODEL] < 1.3 * noise
        assert 1.5 * force[GAUSSIAN_PROCESS_MODEL] < force[BASELINE_MODEL]
    # Between other isobars a Gaussian process reaches the noise as well; beyond them it does not.
    assert between[GAUSSIAN_PROCESS_MODEL] < 1.3 * noise
    assert beyond[SELECTED_MODEL] < 0.8 * beyond[GAUSSIAN_PROCESS_MODEL]
    assert "diameter" not in held_out.rmse[SAROSI_MODEL]
    recording = result.problem.case.recording
    highest = recording.pressure > recording.pressure.max() - 50e3
    assert np.array_equal(extrapolation.held_out_mask, highest)
    document = comparison.as_dict()
    assert document["splits"][0]["rmse"][SELECTED_MODEL]["force"]["value"] == pytest.approx(
        held_out.rmse[SELECTED_MODEL]["force"]
    )
    assert "Sárosi" in str(comparison)


@pytest.mark.parametrize(("made", "words"), [({}, "isobar, 400 kPa"), ({"protocol": lengths}, "180 mm")])
def test_extrapolation_rows_have_the_highest_pressure_or_the_shortest_length(made, words):
    prediction = diagnosis(**made).problem
    out, document_text = find_extrapolation_rows(prediction)
    assert words in document_text
    recording = prediction.case.recording
    edge = recording.pressure == recording.pressure.max() if not made else recording.length < 0.185
    assert np.array_equal(out, edge)
