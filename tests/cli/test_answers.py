"""Commands: results of each command, from an empty folder to a calibrated muscle."""

import json
import re
import shutil

import numpy as np
import pytest

from pamjax.cli.main import main
from pamjax.records.case import read_case
from tests.agreement import RECOVERED


def test_new_writes_a_valid_case(bench, tmp_path, capsys):
    assert main(["new", str(tmp_path / "mine")]) == 0
    output = capsys.readouterr().out
    assert "muscle.toml" in output
    assert f"next: pamjax check {tmp_path / 'mine'}" in output
    assert read_case(tmp_path / "mine").recording.n == 159


def test_example_is_the_simulated_recording_of_the_tutorial(bench, tmp_path):
    friction = ["braid_friction.coefficient=0.6", "braid_friction.presliding=4 mm"]
    words = [str(bench / "stated"), str(bench / "plan.toml"), "--seed", "3", "--with", *friction]
    assert main(["simulate", *words, "--out", str(tmp_path / "again")]) == 0
    example, again = (read_case(folder).recording for folder in (bench / "stated", tmp_path / "again"))
    for channel in ("time", "pressure", "length", "force", "diameter"):
        # The files have seven digits.
        np.testing.assert_allclose(getattr(again, channel), getattr(example, channel), rtol=2e-6)
    # Negative control: without the friction the forces differ by more than the noise.
    plain = read_case(bench / "made").recording.force
    assert np.nanstd(example.force - plain) > 4.0


def test_new_prints_only_json(tmp_path, capsys):
    assert main(["new", str(tmp_path / "mine"), "--json"]) == 0
    output = capsys.readouterr()
    document = json.loads(output.out)
    assert document["case"] == str(tmp_path / "mine")
    assert {path.name for path in (tmp_path / "mine").iterdir()} == set(document["files"])
    assert output.err == ""


def test_new_fleet_says_how_to_run_it(tmp_path, capsys):
    assert main(["new", str(tmp_path / "series"), "--fleet"]) == 0
    file = tmp_path / "series" / "FLEET.toml"
    assert f"next: pamjax fleet {file} --out store" in capsys.readouterr().out
    assert file.is_file()
    assert main(["new", str(tmp_path / "other"), "--fleet", "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {"fleet": str(tmp_path / "other" / "FLEET.toml")}


def test_check_reports_identifiability(bench, capsys):
    assert main(["check", str(bench / "made")]) == 0
    output = capsys.readouterr()
    assert "3 isobars for cross-validation" in output.out
    assert "This recording can determine `muscle.thread_length`" in output.out
    assert output.err == ""


def test_check_reports_an_outlier_once(case, capsys):
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
    output = capsys.readouterr().out
    assert output.count("outlier force 99999 N in row 21: ignored") == 1
    assert "; 1 row lacks pressure or length" in output


def test_check_prints_only_json(bench, capsys):
    assert main(["check", str(bench / "made"), "--json"]) == 0
    output = capsys.readouterr()
    assert json.loads(output.out)["numbers"]["muscle.turns"]["determined"]
    assert output.err == ""


def test_fit_recovers_a_simulated_muscle(fitted):
    document = json.loads((fitted / "fit.json").read_text())
    true = {"muscle.thread_length": 214.0, "muscle.turns": 1.2, "thread.modulus": 70.0}
    for name, value in true.items():
        estimate = document["parameters"][name]
        assert abs(estimate["value"] - value) < RECOVERED * estimate["sd"]
    assert document["converged"]


def test_fit_writes_figures(fitted):
    names = {path.name for path in fitted.iterdir()}
    assert {"fit.json", "fit.nc", "prediction.png", "residual.png", "held-out.png"} <= names
    assert not any(name.startswith(".") for name in names)


def test_fit_recommends_the_next_command(bench, tmp_path, capsys):
    words = ["--out", str(tmp_path / "out"), "--starts", "1", "--folds", "2", "--no-figures", "--no-report"]
    assert main(["fit", str(bench / "made"), *words]) == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"next: pamjax diagnose {bench / 'made'}"


def test_fit_prints_only_json(bench, fitted, tmp_path, capsys):
    arguments = ["--out", str(tmp_path / "out"), "--starts", "2", "--folds", "2", "--json", "--no-figures"]
    assert main(["fit", str(bench / "made"), *arguments]) == 0
    output = capsys.readouterr()
    document = json.loads(output.out)
    # The same options give the same result.
    assert document == json.loads((fitted / "fit.json").read_text())
    assert output.err == f"wrote {tmp_path / 'out'}/: fit.json, fit.nc, report.html\n"


def test_simulation_of_a_calibrated_muscle_is_a_valid_case(fitted, bench, tmp_path, capsys):
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
    # They differ only by noise: 2 N, and 0.5 kPa on some cm².
    assert np.nanstd(made.force - again.force) < 4.0


def test_extrapolation_is_reported(fitted, bench, tmp_path, capsys):
    plan = (bench / "plan.toml").read_text().replace("450 kPa", "600 kPa").replace("[0.2]", "[0.25]")
    (tmp_path / "far.toml").write_text(plan)
    words = [str(fitted / "fit.json"), str(tmp_path / "far.toml"), "--out", str(tmp_path / "far")]
    assert main(["simulate", *words, "--json"]) == 0
    output = capsys.readouterr()
    document = json.loads(output.out)
    assert document["rows"] == read_case(tmp_path / "far").recording.n
    assert document["channels"] == ["force", "diameter"]
    pressure, length = output.err.splitlines()
    assert [f"pamjax: warning: {sentence}" for sentence in document["warnings"]] == [pressure, length]
    assert pressure.startswith("pamjax: warning: pressure is up to 1")
    assert "kPa above the calibrated maximum of 45" in pressure
    assert length.startswith("pamjax: warning: length is up to 9.9")
    assert "mm below the calibrated minimum of 160 mm" in length


def test_mechanisms_can_be_set(bench, tmp_path):
    words = [str(bench / "stated"), str(bench / "plan.toml"), "--no-noise", "--out"]
    assert main(["simulate", *words, str(tmp_path / "plain")]) == 0
    assert main(["simulate", *words, str(tmp_path / "off"), "--with", "force_offset.offset=5 N"]) == 0
    plain, off = (read_case(tmp_path / name).recording.force for name in ("plain", "off"))
    assert np.nanmax(np.abs(off - plain - 5.0)) < 1e-2


@pytest.mark.parametrize(
    ("words", "texts"),
    [
        ([], ["Parameters of a muscle:", "muscle.turns", "braid_friction"]),
        (["thread.modulus"], ["unit      GPa (stored in Pa)", "limits    0.3 to 300", "source"]),
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
        (["braid_friction"], ["confused with", "distinguished by", "braid_friction.coefficient"]),
    ],
)
def test_explain_describes_a_parameter(words, texts, capsys):
    assert main(["explain", *words]) == 0
    output = capsys.readouterr().out
    assert all(text in output for text in texts)


@pytest.mark.parametrize("words", [[], ["viscous_damping"], ["bladder_elasticity"]])
def test_explain_aligns_parameters_in_columns(words, capsys):
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
def test_explain_prints_json(words, numbers, mechanisms, capsys):
    assert main(["explain", *words, "--json"]) == 0
    output = json.loads(capsys.readouterr().out)
    assert list(output["mechanisms"]) == mechanisms
    assert numbers is None or list(output["numbers"]) == numbers
    assert all(number["about"] for number in output["numbers"].values())


def test_validate_prints_json(fitted, bench, capsys):
    assert main(["validate", str(fitted / "fit.json"), str(bench / "made"), "--json"]) == 0
    (output,) = json.loads(capsys.readouterr().out)
    assert output["case"] == "made"
    assert output["seen"]
    assert len(output["blocks"]) == 3
    # 2 N of the load cell; 0.5 kPa and 0.02 mm add about 1.6 N.
    assert 2.2 < output["noise"]["force"] < 3.0
    assert all(block["fits"] for block in output["blocks"])


def test_validate_detects_a_recording_of_the_fit(fitted, bench, tmp_path, capsys):
    words = [str(bench / "stated"), str(bench / "plan.toml"), "--out", str(tmp_path / "again"), "--seed", "4"]
    assert main(["simulate", *words]) == 0
    capsys.readouterr()
    cases = [str(bench / "made"), str(tmp_path / "again")]
    assert main(["validate", str(fitted / "fit.json"), *cases]) == 0
    output = capsys.readouterr().out
    assert "made: the model was fitted to this recording, so this is no validation\n" in output
    assert "again: the model was not fitted to this recording\n" in output


def test_validate_detects_a_recording_with_another_muscle_file(fitted, bench, tmp_path, capsys):
    shutil.copytree(bench / "made", tmp_path / "edited")
    with (tmp_path / "edited" / "muscle.toml").open("a") as file:
        file.write("\n# another comment\n")
    assert main(["validate", str(fitted / "fit.json"), str(tmp_path / "edited"), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[0]["seen"]


def test_validate_detects_every_recording_of_a_joint_fit(fitted, bench, tmp_path, capsys):
    """A joint fit of two muscles used both recordings, also that of the other muscle."""
    document = json.loads((fitted / "fit.json").read_text())
    (case,) = document["cases"].values()
    document["cases"] = {"other": case | {"checksum": "of another"}, "made": case}
    (tmp_path / "fit.json").write_text(json.dumps(document))
    words = ["validate", str(tmp_path / "fit.json"), str(bench / "made"), "--case", "other", "--json"]
    assert main(words) == 0
    assert json.loads(capsys.readouterr().out)[0]["seen"]


def test_stated_muscle_has_no_recording(bench, capsys):
    assert main(["validate", str(bench / "made"), str(bench / "made"), "--json"]) == 0
    assert not json.loads(capsys.readouterr().out)[0]["seen"]


def test_version(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out.strip().count(".") >= 2
