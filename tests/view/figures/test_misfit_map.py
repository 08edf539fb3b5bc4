"""The map of a misfit shows an rms where deviations of both signs cancel in its cells."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax.view.figures.misfit_map import format_map_caption, plot_map
from pamjax.view.reports.cell_titles import _list_titles
from tests.view.made_up import SD, diagnosis, holds


def deviate(sign):
    """Return a diagnosis of holds whose force deviates by ten sd, with a sign for each row."""
    result = diagnosis(holds, named=False, unexplained=True)
    problem = result.problem
    force = problem.predict(result.baseline.estimate.values)[0] + 10 * SD[0] * sign(problem.n)
    problem.measured = np.stack([force, problem.measured[1]])
    region = replace(result.misfit_regions[0], motion="both")
    return replace(result, problem=problem, misfit_regions=[region])


def read_map(result):
    """Return the values, the label of the colours, and the title of the first cell with rows."""
    figure = plot_map(result)
    panel, bar = figure.axes[0], figure.axes[-1]
    (mesh,) = (m for m in panel.collections if m.get_gid() == "misfit")
    return (
        mesh.get_array().compressed(),
        bar.get_ylabel(),
        next(title for title in _list_titles(mesh, panel) if not title.startswith("no")),
    )


def test_deviations_that_cancel_are_drawn_as_rms():
    result = deviate(lambda n: (-1.0) ** np.arange(n))
    values, label, title = read_map(result)
    assert values == pytest.approx(10.0)
    assert label == "force: rms of measured − baseline [noise sd]"
    assert title.startswith("10.0 sd: ")
    assert format_map_caption(result).startswith("Root mean square of measured − baseline in each cell")


def test_deviations_of_one_sign_are_drawn_as_mean():
    result = deviate(lambda n: -np.ones(n))
    values, label, _ = read_map(result)
    assert values == pytest.approx(-10.0)
    assert label == "force: measured − baseline [noise sd]"
    assert format_map_caption(result).startswith("Mean of measured − baseline in each cell")
    assert "Frames show the regions" in format_map_caption(result)


def test_recording_without_misfit_has_a_map_of_means():
    result = diagnosis(holds, detected=False)
    assert read_map(result)[1] == "force: measured − baseline [noise sd]"
    assert "Frames" not in format_map_caption(result)
