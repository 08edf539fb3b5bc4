"""`pamjax plan`: runs, costs, and the information of each channel, without a recording."""

import json
from pathlib import Path

import pandas as pd
import pytest

from pamjax.cli.main import main
from tests.view.html_page import Page

PAPER = str(Path(__file__).parents[3] / "fits" / "chambers_wereley_2022")


def test_files_of_a_plan_agree_with_its_text(planned):
    document = json.loads((planned / "plan.json").read_text())
    assert document["goal"]["parameter"] == "thread.modulus"
    assert document["minutes"] <= 40
    assert sum(run["minutes"] for run in document["runs"]) == pytest.approx(document["minutes"])
    assert set(document["single_channels"]) == {"force", "diameter"}
    modulus = document["parameters"]["thread.modulus"]
    assert modulus["unit"] == "GPa"
    assert modulus["sd_after"] < modulus["sd_before"]
    assert document["goal"]["reached"] == (modulus["sd_after"] <= document["goal"]["sd"])
    table = pd.read_csv(planned / "schedule.csv")
    assert len(table) == document["rows"]
    assert table["pressure [kPa]"].max() <= 600
    assert (planned / "plan.png").stat().st_size > 10_000
    assert (planned / "schedule.png").stat().st_size > 10_000


def test_report_of_a_plan_agrees_with_its_json(planned):
    page = Page((planned / "report.html").read_text("utf-8"))
    document = json.loads((planned / "plan.json").read_text())
    rows = page.table(["run", "repetitions"])
    assert {run: int(cells[0]) for run, cells in rows.items()} == {
        run["run"]: run["count"] for run in document["runs"]
    }
    settled = page.table(["parameter", "value"])
    assert set(settled) == set(document["parameters"])
    after = float(settled["thread.modulus"][2].split()[1])
    assert after == pytest.approx(document["parameters"]["thread.modulus"]["sd_after"], rel=0.06)
    assert f"{document['minutes']:.0f} min" in page.text


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--goal", "thread.modulos"], "Did you mean `thread.modulus`?"),
        (["--goal", "all", "--to", "5 %"], "no wanted standard deviation"),
        (["--to", "5 N"], "unit"),
        (["--to", "5"], "this value needs a unit; got '5' in `--to`."),
        (["--to", "0 %"], "must be positive"),
        (["--minutes", "1"], "the shortest run of this rig takes 1.5 min"),
        (["--distinguish", "braid_friction"], "`--distinguish` needs two mechanisms"),
        (
            ["--distinguish", "braid_friction", "viscous_damping"],
            "`--distinguish` needs a case folder with a recording",
        ),
    ],
)
def test_invalid_goal_is_refused(bench, tmp_path, capsys, words, message):
    arguments = ["plan", str(bench / "stated" / "muscle.toml"), "--out", str(tmp_path), *words]
    assert main(arguments) == 2
    output = capsys.readouterr().err
    assert message in output
    assert output.count("\n") == 1


@pytest.mark.parametrize(
    ("rig", "message"),
    [
        ("contraction = 1.5", "must be a fraction below 0.9"),
        ("force_zero = 5", 'Write "5 N"'),
        ('speed = "0 mm/s"', "positive"),
    ],
)
def test_invalid_rig_is_refused(bench, tmp_path, capsys, rig, message):
    (tmp_path / "rig.toml").write_text(f"[rig]\n{rig}\n")
    words = [str(bench / "stated" / "muscle.toml"), str(tmp_path / "rig.toml"), "--out", str(tmp_path)]
    assert main(["plan", *words]) == 2
    assert message in capsys.readouterr().err


def test_friction_cannot_be_detected_without_time(capsys, tmp_path):
    words = ["--distinguish", "braid_friction", "viscous_damping", "--out", str(tmp_path)]
    assert main(["plan", PAPER, *words]) == 2
    assert "'braid_friction' needs time; got a table without time" in capsys.readouterr().err


@pytest.mark.slow
def test_plan_separates_indistinguishable_mechanisms(rubbed, tmp_path, capsys):
    words = [str(rubbed), "--distinguish", "braid_friction", "viscous_damping", "--out", str(tmp_path)]
    assert main(["plan", *words, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document == json.loads((tmp_path / "discrimination.json").read_text())
    assert [experiment["id"] for experiment in document["protocols"]] == [f"X{k}" for k in range(1, 15)]
    assert document["next_experiment"]["power"] > 0.9
    assert document["explained"]
    page = Page((tmp_path / "report.html").read_text("utf-8"))
    rows = page.table(["id", "protocol"])
    for experiment in document["protocols"]:
        assert float(rows[experiment["id"]][1]) == pytest.approx(experiment["power"], abs=0.0051)
    assert len(page.every("svg")) == 2


@pytest.mark.slow
def test_recording_without_an_explanation_is_reported_first(bench, tmp_path, capsys):
    spent = ["--with", "contact_pressure.threshold=60 kPa", "--seed", "3", "--out", str(tmp_path / "spent")]
    assert main(["simulate", str(bench / "stated"), str(bench / "plan.toml"), *spent]) == 0
    pair = ["--distinguish", "braid_friction", "viscous_damping"]
    words = [str(tmp_path / "spent"), *pair, "--out", str(tmp_path / "told")]
    assert main(["plan", *words]) == 0
    output = capsys.readouterr().out
    assert "neither braid_friction nor viscous_damping explains this recording" in output
    assert "next experiment: " not in output
    document = json.loads((tmp_path / "told" / "discrimination.json").read_text())
    assert not document["explained"]
    assert all(
        experiment["p_value"] < 1e-3 and experiment["rms_over_noise"] > 1.3
        for experiment in document["residual_tests"].values()
    )
    page = (tmp_path / "told" / "report.html").read_text("utf-8")
    assert "<h1>Neither braid_friction nor viscous_damping explains this recording</h1>" in page
