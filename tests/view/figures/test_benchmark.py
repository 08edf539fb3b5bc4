"""Figures of a benchmark show the results of its trials."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax.benchmark.prove import build_tasks
from pamjax.view.figures.benchmark import plot_bank, plot_null, plot_proof
from tests.benchmark.trials import made_up, uniform


@pytest.fixture(scope="module")
def trials():
    counts = {"nothing": 30, "single": 40, "pair": 20, "triple": 10, "outside": 10}
    return [made_up(task) for task in build_tasks(counts, (0.0, 0.5, 0.9))]


def test_every_p_value_is_a_point(trials):
    null_trials = [uniform(task) for task in build_tasks({"nothing": 50}, (0.0, 0.9), stage="score")]
    figure = plot_null(null_trials)
    points = [line for panel in figure.axes for line in panel.get_lines() if line.get_gid() == "p-values"]
    assert [len(line.get_xdata()) for line in points] == [50, 50]
    assert np.allclose(
        np.sort([t.p_value for t in null_trials if t.correlation == 0.9]), points[1].get_ydata()
    )


def test_figure_has_six_panels_whose_titles_state_results(trials):
    figure = plot_proof(trials)
    assert len(figure.axes) == 6
    effect_trials = [t for t in trials if t.kind in ("single", "pair", "triple")]
    share = np.mean([is_named for t in effect_trials for is_named in t.effects_found])
    assert f"{share:.0%} of" in figure.axes[0].get_title("left")


def test_no_figure_without_trials(trials):
    assert plot_null([t for t in trials if t.kind != "nothing"]) is None
    assert plot_proof([t for t in trials if t.kind in ("nothing", "outside")]) is None


def test_reliability_of_a_bank_counts_names_without_a_mechanism_as_wrong(trials):
    right = [hit for t in trials for hit in t.names_right]
    outside = next(t for t in trials if not t.concealed and not t.named)
    wrong = replace(outside, named=("force_offset",), probabilities=(1.0,), reported_ties=((),))
    figure = plot_bank([*trials, wrong])
    assert f"share correct {sum(right) / (len(right) + 1):.2f}" in figure.axes[1].get_title("left")
    assert plot_bank([t for t in trials if not t.concealed]) is None
