"""Comparison methods: predictions of a Gaussian process and of formulas on rows that they did not use."""

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
from tests.view.made_up import diagnosis, lengths


def test_gaussian_process_interpolates_and_returns_to_the_baseline_outside_the_data():
    rng = np.random.default_rng(2)
    x = np.linspace(-2, 6, 400)[:, None]
    residual = np.where(x[:, 0] < 2, 5 * np.sin(2 * x[:, 0]), 0.0) + 0.1 * rng.standard_normal(400)
    training_rows = (x[:, 0] < 2) & (np.abs(x[:, 0]) > 0.2)
    prediction = predict_discrepancy(x, residual, training_rows)
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
    training_rows = level != 2
    prediction = predict_discrepancy((x - x.mean(axis=0)) / x.std(axis=0), residual, training_rows)
    return np.std((prediction - residual)[~training_rows]) / np.std(residual[~training_rows])


def test_gaussian_process_interpolates_between_isobars(monkeypatch):
    assert between_isobars() < 0.15
    # Negative control: with a free length scale, it fits each isobar separately.
    monkeypatch.setattr("pamjax.baselines.gaussian_process.find_widest_gap", lambda values: 0.03)
    assert between_isobars() > 0.25


def test_mechanisms_predict_better_than_the_process_and_the_process_better_than_the_baseline(monkeypatch):
    result = diagnosis()
    # An artificial diagnosis has no model to refit: its earlier prediction replaces the fit without the rows.
    monkeypatch.setattr(
        "pamjax.baselines.comparison._predict_without_rows",
        lambda result, out: (result.gain.before, result.gain.after),
    )
    held = compare_models(result)
    first = held.splits[0]
    assert list(first.rmse) == [BASELINE_MODEL, SELECTED_MODEL, SAROSI_MODEL, GAUSSIAN_PROCESS_MODEL]
    force = {model: by["force"] for model, by in first.rmse.items()}
    assert (
        force[SELECTED_MODEL]
        < 1.1 * held.noise_sd["force"]
        < force[GAUSSIAN_PROCESS_MODEL]
        < force[BASELINE_MODEL]
    )
    assert "diameter" not in first.rmse[SAROSI_MODEL]
    document = held.as_dict()
    assert document["splits"][0]["rmse"][SELECTED_MODEL]["force"]["value"] == pytest.approx(
        force[SELECTED_MODEL]
    )
    assert "Sárosi" in str(held)


@pytest.mark.parametrize(("made", "words"), [({}, "isobar, 400 kPa"), ({"protocol": lengths}, "180 mm")])
def test_extrapolation_rows_have_the_highest_pressure_or_the_shortest_length(made, words):
    prediction = diagnosis(**made).problem
    rows, description = find_extrapolation_rows(prediction)
    assert words in description
    recording = prediction.case.recording
    edge = recording.pressure == recording.pressure.max() if not made else recording.length < 0.185
    assert np.array_equal(rows, edge)
