"""The figure of each mechanism: every panel has its paths and the expected change."""

from functools import cache

import numpy as np
import pytest

from pamjax.cli.main import main
from pamjax.model.mechanism import AbstractMemory
from pamjax.model.registry import MECHANISMS, list_mechanisms
from pamjax.parameter import list_field_meanings
from pamjax.view.figures.mechanism import plot_mechanism
from pamjax.view.figures.mechanism_demo import (
    DEMO_CONTRACTIONS,
    DEMO_CYCLES,
    DEMO_PRESSURES,
    HALF_CYCLE_SAMPLES,
    choose_demo_values,
    simulate_demo,
)

run = cache(simulate_demo)


def compute_change(channel, runs):
    """Return the largest change of a channel, N or m, and the share of rows with a solution."""
    change = np.array([getattr(r, channel) - getattr(r, f"bare_{channel}") for r in runs])
    return np.nanmax(np.abs(change)), np.mean(np.isfinite(change))


@pytest.mark.slow
@pytest.mark.parametrize("kind", MECHANISMS, ids=lambda kind: kind.id)
def test_every_mechanism_has_a_visible_effect(kind):
    (strokes, ramps), declared = run(kind), list_field_meanings(kind)
    assert all(
        declared[name].low <= value <= declared[name].high for name, value in choose_demo_values(kind).items()
    )
    force, solved = compute_change("force", strokes)
    diameter, _ = compute_change("diameter", strokes)
    assert solved == compute_change("force", ramps)[1] == 1
    assert force > 0.5 or diameter > 1e-4
    beside_threads = (
        "force_gain",
        "force_offset",
        "force_drift",
        "channel_lag",
        "viscous_damping",
        "braid_locking",
    )
    assert (diameter < 1e-12) == (kind.id in beside_threads)
    lossy = issubclass(kind, AbstractMemory) or kind.id in ("pressure_drop", "channel_lag", "force_drift")
    loops = [np.abs(_loop(r.force - r.bare_force)) for r in strokes]
    assert (np.max(loops) > 0.5) == lossy


def _loop(change):
    """Return the difference between the two directions of the first cycle."""
    return change[1:HALF_CYCLE_SAMPLES] - change[HALF_CYCLE_SAMPLES + 1 : 2 * HALF_CYCLE_SAMPLES][::-1]


@pytest.mark.slow
@pytest.mark.parametrize("id", ["mullins_softening", "pressure_drop", "viscoelastic_creep"])
def test_every_panel_has_its_paths_and_room_for_its_title(id):
    figure = plot_mechanism(list_mechanisms()[id])
    figure.draw_without_rendering()
    assert id in figure.get_suptitle()
    assert len(figure.axes) == 4
    for panel in figure.axes:
        paths = [line for line in panel.lines if line.get_gid() == "path"]
        groups = len(DEMO_PRESSURES) if "pressure" not in panel.get_xlabel() else len(DEMO_CONTRACTIONS)
        assert 2 * groups <= len(paths) <= 2 * groups * DEMO_CYCLES
        assert all(np.all(np.isfinite(line.get_ydata())) for line in paths)
        assert panel.get_ylabel()[-1] == "]"
        assert panel.title.get_text() == ""
        assert panel._left_title.get_window_extent().x1 <= figure.bbox.x1
    assert len(figure.legends[0].get_texts()) == len(DEMO_PRESSURES) + len(DEMO_CONTRACTIONS) + 3


@pytest.mark.slow
def test_alternative_mechanism_has_its_own_bench():
    strokes, _ = simulate_demo(list_mechanisms()["end_cones"])
    force, solved = compute_change("force", strokes)
    assert solved == 1
    assert 50 < force < 1000


@pytest.mark.slow
def test_repeated_cycles_are_drawn_once():
    def lines(id):
        return sum(line.get_gid() == "path" for line in plot_mechanism(list_mechanisms()[id]).axes[0].lines)

    assert lines("channel_lag") == 2 * len(DEMO_PRESSURES)
    # The first stretch of rubber is not repeated.
    assert 2 * len(DEMO_PRESSURES) < lines("mullins_softening")


@pytest.mark.slow
def test_titles_state_the_result():
    titles = [panel.get_title("left") for panel in plot_mechanism(list_mechanisms()["force_offset"]).axes]
    assert ["+5.0 N" in t for t in titles] == [True, False, False, True]
    assert "no change" in titles[1]


def test_visible_effect_is_not_called_no_change():
    panel = plot_mechanism(list_mechanisms()["braid_friction"]).axes[1]
    y = np.concatenate([line.get_ydata() for line in panel.lines if line.get_gid() == "path"])
    assert 1e-4 < np.abs(y).max() < 2e-3
    assert panel.get_title("left").endswith("change: less than 0.002 mm")
    assert np.diff(panel.get_ylim()) > 4 * np.ptp(y)


def test_explain_draws_the_figure(tmp_path, capsys):
    file = tmp_path / "new" / "rig.png"
    assert main(["explain", "rig_compliance", "--figure", str(file)]) == 0
    assert file.read_bytes()[:4] == b"\x89PNG"
    assert "distinguished by" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            ["thread.modulus", "--figure", "a.png"],
            "`--figure` needs the name of a mechanism; got thread.modulus",
        ),
        (["--figure", "a.png"], "`--figure` needs the name of a mechanism; got no name"),
        (["braid_friction", "--figure", "a.pdf"], "`--figure` must be a PNG file; got a.pdf. Write a.png."),
        (["braid_frction", "--figure", "a.png"], "Did you mean `braid_friction`?"),
    ],
)
def test_mechanism_without_a_figure_is_refused(arguments, message, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["explain", *arguments]) == 2
    assert message in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
