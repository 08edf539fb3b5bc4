"""Thick-walled hoses: the bare braid has a large misfit, and the fit reports it.

The tests run on two simulated hoses of the project. They also run on the hoses of the bench if their case
folders are present (see the README of the folder).
"""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from fits.comparison import compare
from pamjax.infer.fitting.fit import fit
from pamjax.records.case import read_case
from tests.fits.scripts import FITS, import_scripts

#: Two hoses with a known wall, written by simulate_hoses.py.
SIMULATED = FITS / "portland_hose" / "simulated"
#: No licence is stated for the recordings of the bench, so they are not part of the project.
HOSES = Path(os.environ.get("PAMJAX_HOSES", FITS.parents[1] / "shared" / "data" / "portland-hose"))
#: Every tenth row of a real hose still has every length and every test, and its fit is ten times as fast.
EVERY = 10

BRAID, SAROSI, GAYLORD = "braid, inelastic threads", "Sárosi", "Gaylord"
INNER = "inner lengths held out"

needs_hoses = pytest.mark.skipif(not HOSES.is_dir(), reason="the recordings of the bench are not present")


def copy_rows(source, folder, every):
    """Write every n-th row of a case into a folder, and return the new case folder."""
    target = folder / source.name
    target.mkdir(parents=True)
    head, *rows = (source / "recording.csv").read_text(encoding="utf-8").splitlines(keepends=True)
    (target / "recording.csv").write_text(head + "".join(rows[::every]), encoding="utf-8")
    (target / "muscle.toml").write_bytes((source / "muscle.toml").read_bytes())
    return target


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(SIMULATED / "hose-10mm-132", id="simulated"),
        pytest.param(HOSES / "hose-10mm-132", id="hose-10mm-132", marks=needs_hoses),
        pytest.param(HOSES / "hose-20mm-275", id="hose-20mm-275", marks=needs_hoses),
    ],
)
def scored_comparison(request, tmp_path_factory):
    """Return a hose with inelastic threads and its fit, and the comparison with the formulas."""
    folder = request.param
    if folder.parent == HOSES:
        folder = copy_rows(folder, tmp_path_factory.mktemp("hoses"), EVERY)
    case = read_case(folder)
    result = fit(case, "inelastic", starts=1)
    return result, compare(case, [result])


@pytest.mark.slow
def test_misfit_of_the_bare_braid_exceeds_the_noise(scored_comparison):
    result, _ = scored_comparison
    assert result.cases[0].noise["force"].rms_over_noise > 20
    assert "the model may lack a mechanism" in str(result)


@pytest.mark.slow
def test_formula_predicts_better_between_lengths(scored_comparison):
    _, comparison = scored_comparison
    assert comparison.best("in sample") == comparison.best(INNER) == SAROSI
    assert comparison.rmse(BRAID, INNER) > 1.5 * comparison.rmse(SAROSI, INNER)


@pytest.mark.slow
def test_misfit_is_not_due_to_the_priors(scored_comparison):
    """Gaylord's law is the same braid without priors; its misfit is also large."""
    _, comparison = scored_comparison
    assert comparison.rmse(BRAID, "in sample") > comparison.rmse(GAYLORD, "in sample")
    assert comparison.rmse(GAYLORD, "in sample") > 4 * comparison.rmse(SAROSI, "in sample")


@pytest.mark.slow
def test_comparison_ignores_slack_rows(scored_comparison):
    result, comparison = scored_comparison
    force = result.cases[0].case.recording.force
    assert comparison.rows == np.sum(force > comparison.threshold) < len(force)


@pytest.mark.slow
@pytest.mark.parametrize(
    "source",
    [
        pytest.param(SIMULATED / "hose-10mm-132", id="simulated"),
        pytest.param(HOSES / "hose-20mm-275", id="hose-20mm-275", marks=needs_hoses),
    ],
)
def test_the_script_writes_its_comparison_and_figures(source, tmp_path, capsys):
    with import_scripts("portland_hose", "compare_models") as (script,):
        script.THREADS = ("inelastic",)
        copy_rows(source, tmp_path / "cases", EVERY if source.parent == HOSES else 2)
        script.main([str(tmp_path / "cases"), "--out", str(tmp_path / "out")])
    printed = capsys.readouterr().out
    assert f"| {INNER} | {BRAID} | Gaylord | Gaylord, free threshold | {SAROSI} |" in printed
    assert f"| {source.name} | " in printed
    (report,) = json.loads((tmp_path / "out" / "comparison.json").read_text(encoding="utf-8"))
    assert report["rmse_N"][SAROSI]["in sample"] < 0.2 * report["rmse_N"][BRAID]["in sample"]
    assert (tmp_path / "out" / source.name / "inelastic" / "prediction.png").is_file()


def test_the_script_refuses_a_folder_without_cases(tmp_path, capsys):
    with import_scripts("portland_hose", "compare_models") as (script,), pytest.raises(SystemExit):
        script.main([str(tmp_path)])
    assert "A case folder contains muscle.toml and recording.csv." in capsys.readouterr().err


@pytest.mark.slow
def test_two_hoses_of_a_series_have_one_wall():
    with import_scripts("portland_hose", "shared_wall", "simulate_hoses") as (wall, simulation):
        names = ("hose-10mm-132", "hose-10mm-281")
        cases = [wall.read_hose(SIMULATED / name, 8) for name in names]
        separate = [wall.fit_wall([case], folds=2).estimates[wall.WALL[0]] for case in cases]
        agreement = wall.average_values([(estimate.value, estimate.sd) for estimate in separate])
        assert agreement.p_value > 0.05
        shared = wall.fit_wall(cases, wall.WALL, folds=2).estimates[wall.WALL[0]]
        assert min(estimate.value - 2 * estimate.sd for estimate in separate) < shared.value
        assert shared.value < max(estimate.value + 2 * estimate.sd for estimate in separate)
        assert abs(shared.value - simulation.WALL["modulus"]) < 4 * shared.sd
        # A different wall is detected.
        other = (separate[0].value + 1e6, separate[0].sd)
        refuted = wall.average_values([other, (separate[1].value, separate[1].sd)])
        assert refuted.chi2 > agreement.chi2 + 3
        assert refuted.p_value < 0.05


def test_weighted_mean():
    """Two values one tenth from their mean, each with sd 0.1: chi² is 2 with one degree of freedom."""
    with import_scripts("portland_hose", "shared_wall") as (wall,):
        average = wall.average_values([(1.0, 0.1), (1.2, 0.1)])
    assert average.mean == pytest.approx(1.1)
    assert average.sd == pytest.approx(0.1 / np.sqrt(2))
    assert average.chi2 == pytest.approx(2.0)
    assert average.p_value == pytest.approx(0.1573, abs=1e-4)


def test_floor_of_simulated_tests_is_the_noise():
    """Simulated tests differ by sensor noise alone; interpolation averages a part of it away."""
    case = read_case(SIMULATED / "hose-10mm-281")
    with import_scripts("portland_hose", "repeatability_floor") as (script,):
        floor = script.measure_floor(case)
    # Pressure noise adds its sd times the slope of force with pressure, at most 440 N in 620 kPa.
    noise = np.hypot(case.muscle_toml.sensors.force, case.muscle_toml.sensors.pressure * 440 / 620e3)
    assert 0.5 * noise < floor.tests_all_lengths < noise
    assert floor.floor == pytest.approx(np.hypot(floor.tests, floor.ruler))


def test_medians_are_taken_per_test():
    case = read_case(SIMULATED / "hose-10mm-132")
    with import_scripts("portland_hose", "block_medians") as (script,):
        shorter = script.take_medians(case, 6).recording
    tests = np.unique(case.recording.cycle)
    rows = [np.ceil(np.sum(case.recording.cycle == number) / 6) for number in tests]
    assert [np.sum(shorter.cycle == number) for number in tests] == rows
    np.testing.assert_array_equal(np.unique(shorter.length), np.unique(case.recording.length))
    assert shorter.force[0] == np.median(case.recording.force[:6])


def test_simulated_hoses_agree_with_their_script(tmp_path):
    with import_scripts("portland_hose", "simulate_hoses") as (script,):
        script.main([str(tmp_path)])
    for folder in sorted(tmp_path.iterdir()):
        committed, made = read_case(SIMULATED / folder.name), read_case(folder)
        assert made.muscle_toml == committed.muscle_toml
        # Twice the last digit that is written, SI.
        for channel, digit in {"time": 1e-4, "pressure": 0.1, "length": 1e-8, "force": 1e-4}.items():
            values = [getattr(case.recording, channel) for case in (made, committed)]
            np.testing.assert_allclose(*values, rtol=0, atol=2 * digit, err_msg=f"{folder.name}, {channel}")
