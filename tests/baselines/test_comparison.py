"""Rivals beside a gain: a curve learns what it saw, and knows nothing beyond."""

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


def test_a_gaussian_process_learns_between_and_returns_to_the_baseline_beyond():
    rng = np.random.default_rng(2)
    x = np.linspace(-2, 6, 400)[:, None]
    left = np.where(x[:, 0] < 2, 5 * np.sin(2 * x[:, 0]), 0.0) + 0.1 * rng.standard_normal(400)
    told = (x[:, 0] < 2) & (np.abs(x[:, 0]) > 0.2)
    found = predict_discrepancy(x, left, told)
    inside, beyond_it = np.abs(x[:, 0]) <= 0.2, x[:, 0] > 5
    assert np.abs(found - 5 * np.sin(2 * x[:, 0]))[inside].max() < 0.3
    assert np.abs(found[beyond_it]).max() < 1.0
    # Able to fail: what it never saw it does not know.
    assert np.abs(found - 5 * np.sin(2 * x[:, 0]))[x[:, 0] > 3].max() > 3


def between_isobars():
    """How far a process misses an isobar between four others that grow by turns, and the baseline."""
    rng = np.random.default_rng(0)
    level, contraction = np.repeat(np.arange(5), 60), np.tile(np.linspace(0, 1, 60), 5)
    x = np.stack([level + 0.003 * rng.standard_normal(300), contraction], axis=1)
    left = np.sin(3 * contraction) * np.array([0.3, 1.7, 1.0, 0.4, 1.6])[level]
    left += 0.03 * rng.standard_normal(300)
    told = level != 2
    found = predict_discrepancy((x - x.mean(axis=0)) / x.std(axis=0), left, told)
    return np.std((found - left)[~told]) / np.std(left[~told])


def test_a_process_that_stands_for_common_practice_draws_a_curve_from_isobar_to_isobar(monkeypatch):
    assert between_isobars() < 0.15
    # Able to fail: free to be as short as it likes, it fits each isobar by itself.
    monkeypatch.setattr("pamjax.baselines.gaussian_process.find_widest_gap", lambda values: 0.03)
    assert between_isobars() > 0.25


def test_on_the_same_rows_the_curve_beats_the_baseline_and_the_names_beat_the_curve(monkeypatch):
    one = diagnosis()
    # A made-up diagnosis has no model to refit: what it showed before stands for the fit without the rows.
    monkeypatch.setattr(
        "pamjax.baselines.comparison._predict_without_rows",
        lambda one, out: (one.gain.before, one.gain.after),
    )
    held = compare_models(one)
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
def test_beyond_is_the_highest_pressure_or_the_most_contracted_length(made, words):
    found = diagnosis(**made).problem
    out, said = find_extrapolation_rows(found)
    assert words in said
    recording = found.case.recording
    edge = recording.pressure == recording.pressure.max() if not made else recording.length < 0.185
    assert np.array_equal(out, edge)
