"""Figures of a diagnosis: cells, regions, points, lines and titles for every kind of recording."""

from dataclasses import replace

import numpy as np
import pytest

from pamjax.channels import format_channel_value
from pamjax.view.figures import diagnosis_loops
from pamjax.view.figures.diagnosis import plot_candidates, plot_held_out_scores, plot_shifts
from pamjax.view.figures.diagnosis_loops import plot_explained_residuals, plot_loops
from pamjax.view.figures.diagnosis_steps import plot_steps
from pamjax.view.figures.misfit_map import plot_map
from tests.view.made_up import add_form_error, diagnosis, holds, lengths, strokes, table


def panels(figure):
    return [axes for axes in figure.axes if axes.get_label() != "<colorbar>"]


def read_title(panel):
    """Return the title of a panel without line breaks."""
    return " ".join(panel.get_title("left").split())


def select_artists(panel, gid):
    return [artist for artist in panel.get_children() if (artist.get_gid() or "").split(" ")[0] == gid]


def test_map_shows_each_direction_with_sign_and_region():
    figure = plot_map(diagnosis())
    shortening, lengthening = panels(figure)
    assert [shortening.get_title("left"), lengthening.get_title("left")] == [
        "while shortening",
        "while lengthening",
    ]
    means = [select_artists(panel, "misfit")[0].get_array() for panel in (shortening, lengthening)]
    assert np.ma.median(means[0]) == pytest.approx(-10.0, abs=1.0)
    assert np.ma.median(means[1]) == pytest.approx(10.0, abs=1.0)
    assert [len(select_artists(panel, "region-1")) for panel in (shortening, lengthening)] == [0, 1]
    assert figure.get_suptitle() == "Above 100 kPa, force is about 20 N higher while the muscle lengthens"


@pytest.mark.parametrize(
    ("protocol", "labels", "cells"),
    [
        (strokes, ("contraction [%]", "pressure [kPa]"), (4, 18)),
        (lengths, ("contraction [%]", "pressure [kPa]"), (18, 3)),
        (holds, ("contraction [%]", "pressure [kPa]"), (3, 3)),
        (table, ("row", "pressure [kPa]"), (18, 18)),
    ],
)
def test_every_kind_of_recording_has_a_map(protocol, labels, cells):
    panel = panels(plot_map(diagnosis(protocol)))[0]
    assert (panel.get_xlabel(), panel.get_ylabel()) == labels
    assert select_artists(panel, "misfit")[0].get_array().shape == cells


def test_map_without_a_misfit_has_no_region():
    figure = plot_map(diagnosis(detected=False))
    assert not any(select_artists(panel, "region-1") for panel in panels(figure))
    assert figure.get_suptitle().startswith("No part of the recording differs from the baseline")


def test_narrow_figure_has_one_column():
    wide, narrow = (plot_map(diagnosis(), narrow=n) for n in (False, True))
    assert narrow.get_figwidth() < 0.5 * wide.get_figwidth()
    assert len({panel.get_position().x0 for panel in panels(narrow)}) == 1


@pytest.mark.parametrize("protocol", [strokes, lengths, holds, table])
def test_loops_are_drawn_before_and_after(protocol):
    result = diagnosis(protocol)
    before, after = panels(plot_loops(result))
    predicted = [
        np.concatenate([line.get_ydata() for line in p.lines if line.get_gid().startswith("predicted")])
        for p in (before, after)
    ]
    assert np.abs(predicted[1] - predicted[0]).max() > 9
    assert read_title(after).startswith("With braid_friction: held-out RMS error of force ")
    errors = [float(read_title(p).split(" of force ")[1].removesuffix(" N")) for p in (before, after)]
    assert errors[0] > 4 * errors[1]


def test_titles_of_the_loops_have_the_errors_of_the_summary():
    result = diagnosis()
    titles = [read_title(panel) for panel in panels(plot_loops(result))]
    errors = result.held_out_errors
    assert titles == [
        f"{name}: held-out RMS error of force {format_channel_value(rmse['force'], 'force')}"
        for name, rmse in (
            ("Baseline", errors.baseline_rmse),
            ("With braid_friction", errors.model_rmse),
        )
    ]
    held_out, summary = ([t.split(" of force ")[1].removesuffix(" N") for t in titles], str(result))
    assert f"baseline {held_out[0]} N, with mechanisms {held_out[1]} N" in summary
    without = replace(result, held_out_errors=replace(errors, baseline_rmse={}, model_rmse={}))
    assert read_title(panels(plot_loops(without))[0]).startswith("Baseline: RMS error of force")


@pytest.mark.parametrize("is_connected", [True, False])
def test_legend_of_the_loops_has_the_mark_that_is_drawn(monkeypatch, is_connected):
    select = diagnosis_loops.select_shown_groups
    monkeypatch.setattr(
        diagnosis_loops, "select_shown_groups", lambda d: replace(select(d), is_connected=is_connected)
    )
    figure = plot_loops(diagnosis())
    entries = {h.get_label(): h for legend in figure.legends for h in legend.legend_handles}
    drawn = select_artists(panels(figure)[0], "predicted")[0]
    for line in (entries["predicted"], drawn):
        assert (line.get_linestyle() == "-") == is_connected
        assert (line.get_marker() == "x") != is_connected


def test_residual_figure_shows_the_contribution_of_the_mechanism():
    figure = plot_explained_residuals(diagnosis())
    assert [panel.get_title("left") for panel in panels(figure)] == [
        "100 kPa",
        "200 kPa",
        "300 kPa",
        "400 kPa",
    ]
    assert figure.get_suptitle() == "braid_friction explains 99 % of the squared residuals of the baseline"
    assert plot_explained_residuals(diagnosis(named=False)) is None


def test_loops_include_the_form_error_and_its_band():
    result = diagnosis()
    with_form = add_form_error(result)
    exact, (_, inexact) = panels(plot_loops(result))[1], panels(plot_loops(with_form))
    assert read_title(inexact).startswith("With braid_friction and form error: held-out RMS")
    shift = [
        after.get_ydata() - before.get_ydata()
        for after, before in zip(
            select_artists(inexact, "predicted"), select_artists(exact, "predicted"), strict=True
        )
    ]
    assert np.concatenate(shift) == pytest.approx(2.0)
    assert not select_artists(exact, "band")
    entries = [text.get_text() for legend in inexact.figure.legends for text in legend.get_texts()]
    assert "± 2 sd of the prediction, at most 10 N" in entries
    band = select_artists(inexact, "band")[0].get_paths()[0].vertices
    line = select_artists(inexact, "predicted")[0]
    assert np.ptp(band[:, 1]) == pytest.approx(np.ptp(line.get_ydata()) + 4 * 5.0)


def test_residual_figure_shows_the_form_error():
    (panel, *_) = panels(plot_explained_residuals(add_form_error(diagnosis())))
    without, with_form = (select_artists(panel, gid)[0] for gid in ("contribution", "form-error"))
    assert with_form.get_ydata() - without.get_ydata() == pytest.approx(2.0)


def test_band_of_the_form_error_surrounds_its_line_on_both_ways():
    """One area over a stroke and its way back would have no inside."""
    (panel, *_) = panels(plot_explained_residuals(add_form_error(diagnosis())))
    band, line = (select_artists(panel, gid)[0] for gid in ("form-error-band", "form-error"))
    points = np.c_[line.get_xdata(), line.get_ydata()]
    points = points[np.isfinite(points).all(axis=1)]
    inside = np.any([path.contains_points(points, radius=1e-6) for path in band.get_paths()], axis=0)
    assert inside.mean() > 0.9
    assert len(band.get_paths()) > 1


def test_scores_of_held_out_blocks_are_shown_with_their_noise():
    result = diagnosis()
    force, _ = panels(plot_held_out_scores(result))
    document = result.as_dict()
    scores = document["improvement"]["held_out"]["force"]
    assert select_artists(force, "baseline")[0].get_xdata()[-1] == pytest.approx(scores["rmse_before"])
    assert select_artists(force, "model")[0].get_xdata()[-1] == pytest.approx(scores["rmse_after"])
    assert select_artists(force, "noise")[0].get_xdata()[0] == pytest.approx(document["noise"]["force"]["sd"])
    assert [tick.get_text() for tick in force.get_yticklabels()] == ["isobar 300 kPa"]


def test_unmeasured_channel_is_not_drawn():
    assert len(panels(plot_held_out_scores(diagnosis(diameter=False)))) == 1


def test_comparison_methods_are_sorted_by_their_score():
    result = diagnosis(ties=["channel_lag"])
    figure = plot_candidates(result, result.named_mechanisms[0])
    (panel,) = panels(figure)
    assert [tick.get_text() for tick in panel.get_yticklabels()] == [
        "channel_lag",
        "viscous_damping",
        "no mechanism",
    ]
    (increases,) = select_artists(panel, "increase")
    assert increases.get_offsets()[1:, 0].tolist() == [640.0, 5e4]
    # A rival with a better fit is drawn at the axis limit, because the axis is logarithmic.
    assert increases.get_offsets()[0, 0] == panel.get_xlim()[0]
    assert figure.get_suptitle() == "channel_lag fits this recording as well as braid_friction"


def test_parameter_with_the_largest_change_is_first():
    figure = plot_shifts(diagnosis())
    (panel,) = panels(figure)
    assert select_artists(panel, "shift")[0].get_xdata().tolist() == [8.9, -0.2]
    assert figure.get_suptitle() == (
        "1 of 2 parameters shifts by more than 1 sd; largest: thread.modulus, +8.9 sd"
    )
    assert plot_shifts(diagnosis(named=False)) is None


@pytest.mark.parametrize("protocol", [strokes, lengths, holds, table])
def test_steps_have_residuals_before_and_after_on_one_scale(protocol):
    result = diagnosis(protocol=protocol)
    before, rivals, after = panels(plot_steps(result))
    assert [panel.get_title("left")[:2] for panel in (before, rivals, after)] == ["1.", "2.", "3."]
    assert before.get_ylim() == after.get_ylim()
    rms = [
        np.sqrt(np.mean(np.concatenate([line.get_ydata() for line in panel.lines]) ** 2))
        for panel in (before, after)
    ]
    assert rms[0] > 4 * rms[1]
    (increases,) = select_artists(rivals, "increase")
    # The named mechanism is the reference; a rival with a better fit is drawn there too.
    assert increases.get_offsets()[:, 0].tolist() == [0.0, 0.0, 640.0, 5e4]


def test_steps_need_a_mechanism():
    assert plot_steps(diagnosis(named=False)) is None
