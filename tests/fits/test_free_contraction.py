"""Free contractions of hand-made muscles: cases from the table, and predictions of a set from the others."""

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
TABLE = Path(os.environ.get("PAMJAX_FREE_TABLE", TABLES / "fan_continuum_mocap_free_contraction.csv"))

#: Contraction, pressure scale (Pa) and exponent of the simulated sets.
NUMBERS = np.array([0.25, 250e3, 1.5])


@pytest.fixture
def scripts():
    with import_scripts("free_contraction", "build", "compare_models") as modules:
        yield modules


@pytest.fixture
def build(scripts, tmp_path):
    """Return a function from the scale of the first set's contraction to the file of two sets."""

    def write_table(scale_first=1.0):
        pressure = np.linspace(0.0, 500.0, 11)
        sets = [
            pd.DataFrame(
                {
                    "set": name,
                    "pressure_psi": pressure / 6.894757,
                    "pressure_kPa": pressure,
                    "length_m": rest * (1 - scale * scripts[1].evaluate_formula(NUMBERS, 1e3 * pressure)),
                }
            )
            for name, rest, scale in (("a", 0.4, scale_first), ("b", 0.3, 1.0))
        ]
        file = tmp_path / f"table-{scale_first}.csv"
        pd.concat(sets, ignore_index=True).to_csv(file, index=False)
        return file

    return write_table


def test_each_set_is_a_case(scripts, build, tmp_path, capsys):
    file = build()
    scripts[0].main([str(file), "--out", str(tmp_path / "out")])
    assert capsys.readouterr().out.count("wrote ") == 2
    first, second = (read_case(tmp_path / "out" / name) for name in "ab")
    assert first.muscle_toml.rest_length.value == pytest.approx(0.4)
    assert second.muscle_toml.rest_length.value == pytest.approx(0.3)
    assert first.recording.model_channels == ("length", "diameter")
    assert np.all(first.recording.force == 0)
    assert first.recording.pressure[-1] == pytest.approx(500e3)
    text = (tmp_path / "out" / "a" / "muscle.toml").read_text("utf-8")
    assert f"{file.name}, SHA-256 {hashlib.sha256(file.read_bytes()).hexdigest()}." in text


@pytest.mark.parametrize("script", [0, 1])
@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n1,2\n", "unknown columns; got a, b in table.csv. Use the table of the source"),
        ("set,pressure_psi,pressure_kPa,length_m\na,0,0,x\n", "a length; got line 2"),
        ("set,pressure_psi,pressure_kPa,length_m\n,0,0,1\n", "the name of its set; got line 2"),
        ("", "no table with columns; got No columns to parse from file in table.csv. Use the table"),
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


def test_formula_predicts_a_set_that_follows_it(scripts, build, tmp_path):
    for scale in (1.0, 1.1):
        folders = scripts[0].build_cases(build(scale), tmp_path / str(scale))
        cases = [read_case(folder) for folder in folders]
        errors = scripts[1].compute_length_errors(cases, scripts[1].build_formula(cases))
        contraction = scripts[1].evaluate_formula(NUMBERS, cases[0].recording.pressure[1:])
        missed = (scale - 1) * 0.4 * np.sqrt(np.mean(contraction**2))
        # Lengths in the file are rounded to 1 µm.
        assert errors.left_out[0] == pytest.approx(missed, abs=3e-6)


@pytest.mark.slow
@pytest.mark.skipif(not TABLE.exists(), reason="the table is not part of the project")
def test_rubber_predicts_other_sets_better(scripts, tmp_path, capsys):
    script = scripts[1]
    script.MODELS = {name: script.MODELS[name] for name in ("inelastic braid", "with rubber")}
    script.main([str(TABLE), "--out", str(tmp_path)])
    assert "| with rubber | " in capsys.readouterr().out
    document = json.loads((tmp_path / "comparison.json").read_text("utf-8"))
    braid, rubber = (document["rmse_m"][name] for name in script.MODELS)
    for kind in ("fitted", "left_out"):
        assert all(3 * small < large for small, large in zip(rubber[kind], braid[kind], strict=True))
