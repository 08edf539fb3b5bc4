"""Figures of a diagnosis by what they hold: cells, boxes, points, lines, finding; every kind of recording."""

import numpy as np
import pytest

from pamjax.view.figures.diagnosis import plot_candidates, plot_held_out_scores, plot_shifts
from pamjax.view.figures.diagnosis_loops import plot_left_out, plot_loops
from pamjax.view.figures.mismatch_map import plot_map
from tests.view.made_up import diagnosis, holds, lengths, strokes, table


def panels(figure):
    return [axes for axes in figure.axes if axes.get_label() != "<colorbar>"]


def drawn(panel, kind):
    return [artist for artist in panel.get_children() if artist.get_gid() == kind]


def test_the_map_shows_each_direction_with_its_sign_and_its_box():
    figure = plot_map(diagnosis())
    shortening, lengthening = panels(figure)
    assert [shortening.get_title("left"), lengthening.get_title("left")] == [
        "while shortening",
        "while lengthening",
    ]
    means = [drawn(panel, "mismatch")[0].get_array() for panel in (shortening, lengthening)]
    assert np.ma.median(means[0]) == pytest.approx(-10.0, abs=1.0)
    assert np.ma.median(means[1]) == pytest.approx(10.0, abs=1.0)
    assert [len(drawn(panel, "box-1")) for panel in (shortening, lengthening)] == [0, 1]
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
    assert drawn(panel, "mismatch")[0].get_array().shape == cells


def test_nothing_missing_draws_no_box():
    figure = plot_map(diagnosis(detected=False))
    assert not any(drawn(panel, "box-1") for panel in panels(figure))
    assert figure.get_suptitle().startswith("No part of the recording departs from the baseline")


def test_narrow_panels_stand_below_each_other():
    wide, narrow = (plot_map(diagnosis(), narrow=n) for n in (False, True))
    assert narrow.get_figwidth() < 0.5 * wide.get_figwidth()
    assert len({panel.get_position().x0 for panel in panels(narrow)}) == 1


@pytest.mark.parametrize("protocol", [strokes, lengths, holds, table])
def test_loops_stand_before_and_after(protocol):
    one = diagnosis(protocol)
    before, after = panels(plot_loops(one))
    left = [np.concatenate([line.get_ydata() for line in drawn(p, "predicted")]) for p in (before, after)]
    assert np.abs(left[1] - left[0]).max() > 9
    assert after.get_title("left").startswith("With braid_friction: force missed by ")
    words = [float(p.get_title("left").split(" by ")[1].removesuffix(" N")) for p in (before, after)]
    assert words[0] > 4 * words[1]


def test_what_is_left_is_what_the_name_adds():
    figure = plot_left_out(diagnosis())
    assert [panel.get_title("left") for panel in panels(figure)] == [
        "100 kPa",
        "200 kPa",
        "300 kPa",
        "400 kPa",
    ]
    assert (
        figure.get_suptitle() == "99 % of the square of what the baseline leaves is what braid_friction adds"
    )
    assert plot_left_out(diagnosis(named=False)) is None


def test_held_out_blocks_are_scored_beside_their_noise():
    one = diagnosis()
    force, _ = panels(plot_held_out_scores(one))
    told = one.as_dict()
    scores = told["improvement"]["held_out"]["force"]
    assert drawn(force, "before")[0].get_xdata()[-1] == pytest.approx(scores["rmse_before"])
    assert drawn(force, "after")[0].get_xdata()[-1] == pytest.approx(scores["rmse_after"])
    assert drawn(force, "noise")[0].get_xdata()[0] == pytest.approx(told["noise"]["force"]["sd"])
    assert [tick.get_text() for tick in force.get_yticklabels()] == ["isobar 300 kPa"]


def test_a_channel_that_was_not_measured_is_not_drawn():
    assert len(panels(plot_held_out_scores(diagnosis(diameter=False)))) == 1


def test_rivals_stand_in_the_order_of_their_loss():
    one = diagnosis(ties=["channel_lag"])
    figure = plot_candidates(one, one.named_mechanisms[0])
    (panel,) = panels(figure)
    assert [tick.get_text() for tick in panel.get_yticklabels()] == [
        "channel_lag",
        "viscous_damping",
        "nothing",
    ]
    (losses,) = drawn(panel, "loss")
    assert losses.get_offsets()[1:, 0].tolist() == [640.0, 5e4]
    # A rival that fits better stands at the axis: a logarithm has no place for it.
    assert losses.get_offsets()[0, 0] == panel.get_xlim()[0]
    assert figure.get_suptitle() == "channel_lag fits this recording as well as braid_friction"


def test_the_number_that_moved_most_comes_first():
    figure = plot_shifts(diagnosis())
    (panel,) = panels(figure)
    assert drawn(panel, "shift")[0].get_xdata().tolist() == [8.9, -0.2]
    assert figure.get_suptitle() == (
        "1 of 2 numbers moved by more than 1 sd; thread.modulus most, by +8.9 sd"
    )
    assert plot_shifts(diagnosis(named=False)) is None
