"""Each word does what it says: from an empty folder to a calibrated muscle and back."""

import json
import re

import numpy as np
import pytest

from pamjax.cli.main import main
from pamjax.records.case import read_case
from tests.agreement import RECOVERED


def test_new_makes_a_case_that_reads(bench, tmp_path, capsys):
    assert main(["new", str(tmp_path / "mine")]) == 0
    said = capsys.readouterr().out
    assert "muscle.toml" in said
    assert f"then: pamjax check {tmp_path / 'mine'}" in said
    assert read_case(tmp_path / "mine").recording.n == 3


def test_new_speaks_json_alone(tmp_path, capsys):
    assert main(["new", str(tmp_path / "mine"), "--json"]) == 0
    said = capsys.readouterr()
    document = json.loads(said.out)
    assert document["case"] == str(tmp_path / "mine")
    assert {path.name for path in (tmp_path / "mine").iterdir()} == set(document["files"])
    assert said.err == ""


def test_check_says_what_could_be_known(bench, capsys):
    assert main(["check", str(bench / "made")]) == 0
    said = capsys.readouterr()
    assert "3 isobars to hold out in turn" in said.out
    assert "This recording can determine `muscle.thread_length`" in said.out
    assert said.err == ""


def test_check_tells_a_cell_that_was_set_aside_once(case, capsys):
    folder = case()
    lines = (folder / "recording.csv").read_text().splitlines()
    header = lines[0].split(",")
    place = next(k for k, title in enumerate(header) if title.startswith("force"))
    cells = lines[20].split(",")
    cells[place] = "99999"
    blank = lines[30].split(",")
    blank[next(k for k, title in enumerate(header) if title.startswith("length"))] = ""
    lines[20], lines[30] = ",".join(cells), ",".join(blank)
    (folder / "recording.csv").write_text("\n".join(lines) + "\n")
    assert main(["check", str(folder)]) == 0
    said = capsys.readouterr().out
    assert said.count("force 99999 N in row 21 was set aside") == 1
    assert "; 1 row lacks pressure or length" in said


def test_check_speaks_json_alone(bench, capsys):
    assert main(["check", str(bench / "made"), "--json"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["numbers"]["muscle.turns"]["determined"]
    assert said.err == ""


def test_a_simulated_muscle_is_found_again(fitted):
    document = json.loads((fitted / "fit.json").read_text())
    true = {"muscle.thread_length": 214.0, "muscle.turns": 1.2, "thread.modulus": 70.0}
    for name, value in true.items():
        found = document["parameters"][name]
        assert abs(found["value"] - value) < RECOVERED * found["sd"]
    assert document["converged"]


def test_a_fit_writes_its_figures(fitted):
    names = {path.name for path in fitted.iterdir()}
    assert {"fit.json", "fit.nc", "prediction.png", "residual.png", "held-out.png"} <= names
    assert not any(name.startswith(".") for name in names)


def test_a_fit_says_what_comes_next(bench, tmp_path, capsys):
    words = ["--out", str(tmp_path / "out"), "--starts", "1", "--folds", "2", "--no-figures", "--no-report"]
    assert main(["fit", str(bench / "made"), *words]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"then: pamjax diagnose {bench / 'made'}"


def test_fit_speaks_json_alone(bench, fitted, tmp_path, capsys):
    arguments = ["--out", str(tmp_path / "out"), "--starts", "2", "--folds", "2", "--json", "--no-figures"]
    assert main(["fit", str(bench / "made"), *arguments]) == 0
    said = capsys.readouterr()
    document = json.loads(said.out)
    # The same words, the same answer.
    assert document == json.loads((fitted / "fit.json").read_text())
    assert said.err == f"wrote {tmp_path / 'out'}/: fit.json, fit.nc, report.html\n"


def test_a_calibrated_muscle_is_simulated_and_read(fitted, bench, tmp_path, capsys):
    words = [
        str(fitted / "fit.json"),
        str(bench / "plan.toml"),
        "--out",
        str(tmp_path / "again"),
        "--no-noise",
    ]
    assert main(["simulate", *words]) == 0
    assert capsys.readouterr().err == ""
    made, again = (read_case(folder).recording for folder in (bench / "made", tmp_path / "again"))
    # Only noise lies between them: 2 N, and 0.5 kPa on some cm².
    assert np.nanstd(made.force - again.force) < 4.0


def test_leaving_the_calibrated_range_is_told(fitted, bench, tmp_path, capsys):
    plan = (bench / "plan.toml").read_text().replace("450 kPa", "600 kPa").replace("[0.2]", "[0.25]")
    (tmp_path / "far.toml").write_text(plan)
    words = [str(fitted / "fit.json"), str(tmp_path / "far.toml"), "--out", str(tmp_path / "far")]
    assert main(["simulate", *words, "--json"]) == 0
    said = capsys.readouterr()
    document = json.loads(said.out)
    assert document["rows"] == read_case(tmp_path / "far").recording.n
    assert document["channels"] == ["force", "diameter"]
    pressure, length = said.err.splitlines()
    assert [f"pamjax: warning: {sentence}" for sentence in document["warnings"]] == [pressure, length]
    assert pressure.startswith("pamjax: warning: pressure goes 1")
    assert "kPa above the calibrated 45" in pressure
    assert length.startswith("pamjax: warning: length goes 9.9")
    assert "mm below the calibrated 160 mm" in length


def test_mechanisms_can_be_set(bench, tmp_path):
    words = [str(bench / "stated"), str(bench / "plan.toml"), "--no-noise", "--out"]
    assert main(["simulate", *words, str(tmp_path / "plain")]) == 0
    assert main(["simulate", *words, str(tmp_path / "off"), "--with", "force_offset.offset=5 N"]) == 0
    plain, off = (read_case(tmp_path / name).recording.force for name in ("plain", "off"))
    assert np.nanmax(np.abs(off - plain - 5.0)) < 1e-2


@pytest.mark.parametrize(
    ("words", "texts"),
    [
        ([], ["Numbers of a muscle:", "muscle.turns", "braid_friction"]),
        (["thread.modulus"], ["unit      GPa (kept in Pa)", "limits    0.3 to 300", "source"]),
        (
            ["thread.crimp"],
            [
                "thread.crimp (law toe): strain at which the threads are straight",
                "thread.crimp (law exponential-toe): strain at which",
                "thread.crimp (law recruitment-toe): mean slack of the filaments",
            ],
        ),
        (["thread.stiffness"], ["thread.stiffness: pull of all threads", "limits    0.0001 to 1000"]),
        (["muscle.turns"], ["turns N of one thread"]),
        (["braid_friction"], ["mistaken for", "told apart by", "braid_friction.coefficient"]),
    ],
)
def test_explain(words, texts, capsys):
    assert main(["explain", *words]) == 0
    said = capsys.readouterr().out
    assert all(text in said for text in texts)


@pytest.mark.parametrize("words", [[], ["viscous_damping"], ["bladder_elasticity"]])
def test_explained_numbers_stand_in_columns(words, capsys):
    assert main(["explain", *words]) == 0
    blocks = [set()]
    for line in capsys.readouterr().out.splitlines():
        if numbered := re.match(r" +[a-z_]+\.[a-z_]+ ", line):
            unit = re.compile(r" +(\S+) {2,}(?=\S)").match(line, numbered.end() - 1)
            assert unit, line
            blocks[-1].add((unit.start(1), unit.end()))
        else:
            blocks.append(set())
    places = [block for block in blocks if block]
    assert places
    assert all(len(block) == 1 for block in places)


@pytest.mark.parametrize(
    ("words", "numbers", "mechanisms"),
    [
        (["muscle.turns"], ["muscle.turns"], []),
        (["end_taper"], None, ["end_taper"]),
    ],
)
def test_explain_speaks_json(words, numbers, mechanisms, capsys):
    assert main(["explain", *words, "--json"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert list(said["mechanisms"]) == mechanisms
    assert numbers is None or list(said["numbers"]) == numbers
    assert all(number["about"] for number in said["numbers"].values())


def test_validate_speaks_json(fitted, bench, capsys):
    assert main(["validate", str(fitted / "fit.json"), str(bench / "made"), "--json"]) == 0
    (said,) = json.loads(capsys.readouterr().out)
    assert said["case"] == "made"
    assert said["seen"]
    assert len(said["blocks"]) == 3
    # 2 N of the load cell; half a kPa and a fiftieth of a mm do about another 1.6 N.
    assert 2.2 < said["noise"]["force"] < 3.0
    assert all(block["fits"] for block in said["blocks"])


def test_validate_tells_a_recording_that_was_fitted_from_another(fitted, bench, tmp_path, capsys):
    words = [str(bench / "stated"), str(bench / "plan.toml"), "--out", str(tmp_path / "again"), "--seed", "4"]
    assert main(["simulate", *words]) == 0
    capsys.readouterr()
    cases = [str(bench / "made"), str(tmp_path / "again")]
    assert main(["validate", str(fitted / "fit.json"), *cases]) == 0
    said = capsys.readouterr().out
    assert "made: a model fitted to this very recording, which is no test of it\n" in said
    assert "again: a model that never saw it\n" in said


def test_validate_knows_every_recording_of_a_fit(fitted, bench, tmp_path, capsys):
    """Of a fit of two muscles together, the one that is not asked for was seen as well."""
    document = json.loads((fitted / "fit.json").read_text())
    (case,) = document["cases"].values()
    document["cases"] = {"other": case | {"checksum": "of another"}, "made": case}
    (tmp_path / "fit.json").write_text(json.dumps(document))
    words = ["validate", str(tmp_path / "fit.json"), str(bench / "made"), "--case", "other", "--json"]
    assert main(words) == 0
    assert json.loads(capsys.readouterr().out)[0]["seen"]


def test_a_stated_muscle_saw_nothing(bench, capsys):
    assert main(["validate", str(bench / "made"), str(bench / "made"), "--json"]) == 0
    assert not json.loads(capsys.readouterr().out)[0]["seen"]


def test_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.strip().count(".") >= 2
