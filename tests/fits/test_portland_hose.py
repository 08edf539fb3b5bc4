"""Hoses with a thick wall: the bare braid is far off, and is told so; recordings beside the project only."""

import importlib
import json
import sys
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from fits.comparison import compare
from pamjax.infer.fitting.fit import fit
from pamjax.records.case import read_case

FOLDER = Path(__file__).parents[2] / "fits" / "portland_hose"
#: No licence is stated for the recordings, so they are not part of the project.
HOSES = Path(__file__).parents[2].parent / "shared" / "data" / "portland-hose"
#: Every tenth row has every length and every test still, and is fitted ten times as fast.
EVERY = 10

BRAID, SAROSI, GAYLORD = "braid, inelastic threads", "Sárosi", "Gaylord"
INNER = "inner lengths held out"

pytestmark = pytest.mark.skipif(not HOSES.is_dir(), reason="no hose recordings beside the project")


def thinned(name, folder):
    """A copy of a case with every tenth row."""
    made = folder / name
    made.mkdir(parents=True)
    head, *rows = (HOSES / name / "recording.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    (made / "recording.csv").write_text(head + "".join(rows[::EVERY]), encoding="utf-8")
    (made / "muscle.toml").write_bytes((HOSES / name / "muscle.toml").read_bytes())
    return made


@pytest.fixture(scope="module", params=["hose-10mm-132", "hose-20mm-275"])
def scored(request, tmp_path_factory):
    """A fit of a hose with inelastic threads, and its scores beside the rivals'."""
    case = read_case(thinned(request.param, tmp_path_factory.mktemp("hoses")))
    fitted = fit(case, "inelastic", starts=1)
    return fitted, compare(case, [fitted])


def test_the_bare_braid_misses_more_than_its_noise(scored):
    fitted, _ = scored
    assert fitted.cases[0].noise["force"].excess > 20
    assert "the model misses something" in str(fitted)


def test_the_formula_wins_between_lengths(scored):
    _, found = scored
    assert found.best("in sample") == found.best(INNER) == SAROSI
    assert found.rmse(BRAID, INNER) > 1.5 * found.rmse(SAROSI, INNER)


def test_it_is_the_law_not_its_priors(scored):
    """Gaylord's law is the same braid without priors: freed of them it is still far off."""
    _, found = scored
    assert found.rmse(BRAID, "in sample") > found.rmse(GAYLORD, "in sample")
    assert found.rmse(GAYLORD, "in sample") > 4 * found.rmse(SAROSI, "in sample")


def test_slack_rows_are_left_out_of_the_comparison(scored):
    fitted, found = scored
    force = fitted.cases[0].case.recording.force
    assert found.rows == np.sum(force > found.threshold) < len(force)


@contextmanager
def script(name):
    """A module of the folder, which imports its neighbours by name as a script does."""
    before = set(sys.modules)
    sys.path.insert(0, str(FOLDER))
    try:
        yield importlib.import_module(name)
    finally:
        sys.path.remove(str(FOLDER))
        for one in {path.stem for path in FOLDER.glob("*.py")} - before:
            sys.modules.pop(one, None)


@pytest.mark.slow
def test_the_script_writes_its_comparison_and_figures(tmp_path, capsys):
    with script("compare") as compared:
        compared.THREADS = ("inelastic",)
        thinned("hose-20mm-275", tmp_path / "cases")
        compared.main([str(tmp_path / "cases"), "--out", str(tmp_path / "out")])
    said = capsys.readouterr().out
    assert f"| {INNER} | {BRAID} | Gaylord | Gaylord, free threshold | {SAROSI} |" in said
    assert "| hose-20mm-275 | " in said
    (report,) = json.loads((tmp_path / "out" / "comparison.json").read_text(encoding="utf-8"))
    assert report["rmse_N"][SAROSI]["in sample"] < 0.2 * report["rmse_N"][BRAID]["in sample"]
    assert (tmp_path / "out" / "hose-20mm-275" / "inelastic" / "prediction.png").is_file()


@pytest.mark.slow
def test_two_hoses_of_a_series_have_one_wall():
    with script("together") as series:
        names = ("hose-10mm-132", "hose-10mm-281")
        cases = [series.thinned(series.believed(HOSES / name), 5) for name in names]
        apart = [series.fitted([case], folds=2).estimates[series.WALL[0]] for case in cases]
        *_, squares, p = series.agreement([(one.value, one.sd) for one in apart])
        assert p > 0.05
        shared = series.fitted(cases, series.WALL, folds=2).estimates[series.WALL[0]]
        assert min(one.value - 2 * one.sd for one in apart) < shared.value
        assert shared.value < max(one.value + 2 * one.sd for one in apart)
        # A wall that is another is told apart.
        other = (apart[0].value + 1e6, apart[0].sd)
        *_, farther, refuted = series.agreement([other, (apart[1].value, apart[1].sd)])
        assert farther > squares + 3
        assert refuted < 0.05
