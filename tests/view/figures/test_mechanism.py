"""A figure of each mechanism: every panel has its paths, and something changes that should."""

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


def changed(channel, runs):
    """Largest change of a channel, N or m, and what share of the samples has a solution."""
    change = np.array([getattr(r, channel) - getattr(r, f"bare_{channel}") for r in runs])
    return np.nanmax(np.abs(change)), np.mean(np.isfinite(change))


@pytest.mark.slow
@pytest.mark.parametrize("kind", MECHANISMS, ids=lambda kind: kind.id)
def test_every_mechanism_shows(kind):
    (strokes, ramps), declared = run(kind), list_field_meanings(kind)
    assert all(
        declared[name].low <= value <= declared[name].high for name, value in choose_demo_values(kind).items()
    )
    force, solved = changed("force", strokes)
    diameter, _ = changed("diameter", strokes)
    assert solved == changed("force", ramps)[1] == 1
    assert force > 0.5 or diameter > 1e-4
    sensor = kind.id in ("force_gain", "force_offset", "force_drift", "channel_lag", "viscous_damping")
    assert (diameter < 1e-12) == sensor
    lossy = issubclass(kind, AbstractMemory) or kind.id in ("pressure_drop", "channel_lag", "force_drift")
    loops = [np.abs(_loop(r.force - r.bare_force)) for r in strokes]
    assert (np.max(loops) > 0.5) == lossy


def _loop(change):
    """Difference between the two ways of the first cycle."""
    return change[1:HALF_CYCLE_SAMPLES] - change[HALF_CYCLE_SAMPLES + 1 : 2 * HALF_CYCLE_SAMPLES][::-1]


@pytest.mark.slow
@pytest.mark.parametrize("id", ["mullins_softening", "pressure_drop", "viscoelastic_creep"])
def test_every_panel_has_its_paths_and_room_for_its_title(id):
    made = plot_mechanism(list_mechanisms()[id])
    made.draw_without_rendering()
    assert id in made.get_suptitle()
    assert len(made.axes) == 4
    for panel in made.axes:
        paths = [line for line in panel.lines if line.get_gid() == "path"]
        groups = len(DEMO_PRESSURES) if "pressure" not in panel.get_xlabel() else len(DEMO_CONTRACTIONS)
        assert 2 * groups <= len(paths) <= 2 * groups * DEMO_CYCLES
        assert all(np.all(np.isfinite(line.get_ydata())) for line in paths)
        assert panel.get_ylabel()[-1] == "]"
        assert panel.title.get_text() == ""
        assert panel._left_title.get_window_extent().x1 <= made.bbox.x1
    assert len(made.legends[0].get_texts()) == len(DEMO_PRESSURES) + len(DEMO_CONTRACTIONS) + 3


@pytest.mark.slow
def test_an_alternative_has_a_bench_of_its_own():
    strokes, _ = simulate_demo(list_mechanisms()["end_cones"])
    force, solved = changed("force", strokes)
    assert solved == 1
    assert 50 < force < 1000


def test_what_comes_again_is_drawn_once():
    def lines(id):
        return sum(line.get_gid() == "path" for line in plot_mechanism(list_mechanisms()[id]).axes[0].lines)

    assert lines("channel_lag") == 2 * len(DEMO_PRESSURES)
    # The first stretch of rubber does not come again.
    assert 2 * len(DEMO_PRESSURES) < lines("mullins_softening")


def test_titles_say_what_is_found():
    titles = [panel.get_title("left") for panel in plot_mechanism(list_mechanisms()["force_offset"]).axes]
    assert ["+5.0 N" in t for t in titles] == [True, False, False, True]
    assert "no change" in titles[1]


def test_what_is_seen_is_not_called_no_change():
    panel = plot_mechanism(list_mechanisms()["braid_friction"]).axes[1]
    drawn = np.concatenate([line.get_ydata() for line in panel.lines if line.get_gid() == "path"])
    assert 1e-4 < np.abs(drawn).max() < 2e-3
    assert panel.get_title("left").endswith("diameter: less than 0.002 mm")
    assert np.diff(panel.get_ylim()) > 4 * np.ptp(drawn)


def test_explain_draws(tmp_path, capsys):
    file = tmp_path / "new" / "rig.png"
    assert main(["explain", "rig_compliance", "--figure", str(file)]) == 0
    assert file.read_bytes()[:4] == b"\x89PNG"
    assert "told apart by" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["thread.modulus", "--figure", "a.png"], "a figure is drawn of a mechanism; got thread.modulus"),
        (["--figure", "a.png"], "a figure is drawn of a mechanism; got no name"),
        (["braid_friction", "--figure", "a.pdf"], "`--figure` is a PNG file; got a.pdf. Name it a.png."),
        (["braid_frction", "--figure", "a.png"], "Did you mean `braid_friction`?"),
    ],
)
def test_what_cannot_be_drawn_is_told(words, told, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert main(["explain", *words]) == 2
    assert told in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
