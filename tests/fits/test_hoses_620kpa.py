"""The hand readings at 620 kPa: cases from the table, and the prediction of a hose from the others."""

import hashlib
import json
import os
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from pamjax.records.case import read_case
from tests.fits.scripts import FITS, import_scripts

TABLES = FITS.parents[1] / "shared" / "data" / "tables"
#: The table of the source, which is not part of the project.
TABLE = Path(os.environ.get("PAMJAX_HOSE_TABLE", TABLES / "bolen_straight_force_test_620kPa.csv"))

CONTRACTION = np.linspace(0.0, 0.2, 6)


def compute_parabola(contraction):
    return 500 - 2000 * contraction + 500 * contraction**2


def write_table(file, compute_force=compute_parabola, scale_first=1.0, shift_tendon=0.0):
    """Write readings of two hoses, one of them with and without a tendon, and return the file."""
    hoses = [
        pd.DataFrame(
            {
                "lrest_mm": rest,
                "length_mm": rest * (1 - CONTRACTION),
                "force_N": scale * compute_force(CONTRACTION) + shift,
                "pressure_kPa": 620,
                "note": note,
            }
        )
        for rest, note, scale, shift in (
            (100, "", scale_first, 0.0),
            (200, "", 1.0, 0.0),
            (200, "brake-cable tendon in series", 1.0, shift_tendon),
        )
    ]
    pd.concat(hoses, ignore_index=True).to_csv(file, index=False)
    return file


@pytest.fixture
def scripts():
    with import_scripts("hoses_620kpa", "build", "compare_models") as modules:
        yield modules


@pytest.fixture
def build(scripts, tmp_path):
    """Return a function from the readings to the cases."""

    def build_cases(**readings):
        folder = tmp_path / str(len(list(tmp_path.iterdir())))
        folder.mkdir()
        file = write_table(folder / "table.csv", **readings)
        return [read_case(case) for case in scripts[0].build_cases(file, folder)]

    return build_cases


def test_each_rest_length_and_tendon_is_a_case(scripts, tmp_path, capsys):
    file = write_table(tmp_path / "table.csv")
    scripts[0].main([str(file), "--out", str(tmp_path / "out")])
    names = ["hose-100", "hose-200", "hose-200-brake-cable"]
    assert capsys.readouterr().out.split() == [
        word for name in names for word in ("wrote", str(tmp_path / "out" / name))
    ]
    cases = [read_case(tmp_path / "out" / name) for name in names]
    assert [case.muscle_toml.rest_length.value for case in cases] == pytest.approx([0.1, 0.2, 0.2])
    assert cases[2].muscle_toml.sensors.length == pytest.approx(1e-3)
    assert cases[0].recording.pressure == pytest.approx(620e3)
    assert cases[0].recording.force == pytest.approx(compute_parabola(CONTRACTION))
    text = (tmp_path / "out" / names[0] / "muscle.toml").read_text("utf-8")
    assert f"table.csv, SHA-256 {hashlib.sha256(file.read_bytes()).hexdigest()}." in text


@pytest.mark.parametrize("script", [0, 1])
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n1,2\n", "unknown columns; got a, b in table.csv. Use the table of the source"),
        (
            "lrest_mm,length_mm,force_N,pressure_kPa,note\n1,2,x,620,\n",
            "force and pressure; got line 2",
        ),
        ("", "no table with columns; got No columns to parse from file in table.csv. Use the table"),
        ('"a,b\n1,2\n', "in table.csv"),
        (None, "table.csv"),
    ],
)
def test_wrong_table_is_refused(scripts, script, text, message, tmp_path, capsys):
    file = tmp_path / "table.csv"
    if text is not None:
        file.write_text(text)
    with pytest.raises(SystemExit) as exit:
        scripts[script].main([str(file), "--out", str(tmp_path / "out")])
    assert exit.value.code == 2
    assert message in capsys.readouterr().err


@pytest.mark.parametrize(
    ("formula", "compute_force"),
    [("parabola", compute_parabola), ("Sárosi's formula", lambda k: 300 * np.exp(-9 * k) + 200 - 900 * k)],
)
def test_formula_predicts_a_hose_that_follows_it(scripts, build, formula, compute_force):
    cases, script = build(compute_force=compute_force), scripts[1]
    predict = script.build_formula(cases, script.FORMULAS[formula])
    errors = script.compute_errors(cases, predict, script.list_rest_lengths(cases))
    assert max(errors.fitted + errors.left_out) < 1e-3
    # A hose that is 10 % stronger is missed by 10 % if it is left out.
    stronger = build(compute_force=compute_force, scale_first=1.1)
    predict = script.build_formula(stronger, script.FORMULAS[formula])
    errors = script.compute_errors(stronger, predict, script.list_rest_lengths(stronger))
    rms = np.sqrt(np.mean(compute_force(CONTRACTION) ** 2))
    assert errors.left_out[0] == pytest.approx(0.1 * rms, rel=1e-3)
    assert errors.fitted[0] < errors.left_out[0]


def test_series_of_one_hose_are_left_out_together(scripts, build):
    kept_series = []

    def predict(kept):
        kept_series.append(list(kept))
        return [np.zeros(case.recording.n) for case in cases]

    cases = build()
    scripts[1].compute_errors(cases, predict, scripts[1].list_rest_lengths(cases))
    assert kept_series == [[0, 1, 2], [1, 2], [0], [0]]


def test_series_that_is_left_out_does_not_influence_its_prediction(scripts, build):
    script, predictions = scripts[1], []
    for scale in (1.0, 1.5):
        cases = build(scale_first=scale)
        shared = script.list_shared(cases[0], "inelastic", ())
        assert shared == ["muscle.braid_angle", "muscle.diameter"]
        fitted = script.fit(cases, "inelastic", shared, starts=1, fold_count=2)
        predictions.append(script.build_model(fitted)([1, 2])[0])
    assert predictions[0] == pytest.approx(predictions[1], rel=0.02)
    assert np.abs(predictions[0] - compute_parabola(CONTRACTION)).max() > 5


def test_shared_parameters_with_own_dimensions(scripts, build):
    case = build()[0]
    shared = scripts[1].list_shared(case, "inelastic", ("bladder_elasticity",), own_dimensions=True)
    assert shared == ["bladder_elasticity.modulus", "bladder_elasticity.mooney"]


def test_reading_errors(scripts, build):
    """A straight line of 5 N/mm, and a second series that is 7 N higher."""
    cases = build(compute_force=lambda k: 500 - 1000 * k, shift_tendon=7.0)
    forces = [case.recording.force for case in cases]
    # 1000 N over the rest length of 100 and 200 mm.
    assert scripts[1].compute_ruler_errors(cases, lambda kept: forces) == pytest.approx([10.0, 5.0, 5.0])
    assert scripts[1].compute_repeat_differences(cases) == pytest.approx(
        {"hose-200 and hose-200-brake-cable": 7.0}
    )


def test_table_has_newtons_percent_and_all_rows(scripts, build):
    cases = build()
    errors = {"model": scripts[1].SeriesErrors([3.0, 4.0, 5.0], [30.0, 40.0, 50.0])}
    for unit, cell, last in (("N", "3, 30", "4.08, 40.8"), ("%", "0.6, 6", "0.816, 8.16")):
        head, _, row = scripts[1].format_errors(cases, errors, unit).splitlines()
        assert head == f"| {unit} | 100 | 200 | 200-brake-cable | all rows |"
        assert row.startswith(f"| model | {cell} | ")
        assert row.endswith(f"| {last} |")


@pytest.mark.slow
@pytest.mark.skipif(not TABLE.exists(), reason="the table is not part of the project")
def test_rubber_predicts_other_hoses_better(scripts, tmp_path, capsys):
    script = scripts[1]
    script.MODELS = {name: script.MODELS[name] for name in ("inelastic braid", "with rubber")}
    script.main([str(TABLE), "--out", str(tmp_path)])
    assert "| with rubber | " in capsys.readouterr().out
    document = json.loads((tmp_path / "comparison.json").read_text("utf-8"))
    assert len(document["cases"]) == 5
    braid, rubber = (document["rmse_N"][name] for name in script.MODELS)
    for kind in ("fitted", "left_out"):
        assert all(small < large for small, large in zip(rubber[kind], braid[kind], strict=True))
    own = document["rmse_N"][script.OWN_DIMENSIONS]
    assert np.mean(own["fitted"]) < np.mean(rubber["fitted"])
    assert np.mean(own["left_out"]) > np.mean(rubber["left_out"])
