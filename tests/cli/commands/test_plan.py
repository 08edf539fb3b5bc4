"""`pamjax plan`: a user without data is told what to do, what it costs and what one channel alone could."""

import json
from pathlib import Path

import pandas as pd
import pytest

from pamjax.cli.main import main
from tests.view.html_page import Page

PAPER = str(Path(__file__).parents[3] / "fits" / "chambers_wereley_2022")


def test_a_plan_is_written_as_it_is_told(planned):
    document = json.loads((planned / "plan.json").read_text())
    assert document["goal"]["number"] == "thread.modulus"
    assert document["minutes"] <= 40
    assert sum(run["minutes"] for run in document["runs"]) == pytest.approx(document["minutes"])
    assert set(document["alone"]) == {"force", "diameter"}
    modulus = document["settles"]["thread.modulus"]
    assert modulus["unit"] == "GPa"
    assert modulus["sd_after"] < modulus["sd_before"]
    assert document["goal"]["reached"] == (modulus["sd_after"] <= document["goal"]["sd"])
    table = pd.read_csv(planned / "schedule.csv")
    assert len(table) == document["rows"]
    assert table["pressure [kPa]"].max() <= 600
    assert (planned / "plan.png").stat().st_size > 10_000
    assert (planned / "schedule.png").stat().st_size > 10_000


def test_a_plans_report_says_what_its_json_says(planned):
    page = Page((planned / "report.html").read_text("utf-8"))
    document = json.loads((planned / "plan.json").read_text())
    told = page.table(["run", "times"])
    assert {run: int(cells[0]) for run, cells in told.items()} == {
        run["run"]: run["count"] for run in document["runs"]
    }
    settled = page.table(["number", "believed"])
    assert set(settled) == set(document["settles"])
    after = float(settled["thread.modulus"][2].split()[1])
    assert after == pytest.approx(document["settles"]["thread.modulus"]["sd_after"], rel=0.06)
    assert f"{document['minutes']:.0f} min" in page.text


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--goal", "thread.modulos"], "Did you mean `thread.modulus`?"),
        (["--goal", "all", "--to", "5 %"], "no wanted standard deviation"),
        (["--to", "5 N"], "unit"),
        (["--to", "5"], "this number needs a unit; got '5' in --to."),
        (["--to", "0 %"], "is positive"),
        (["--minutes", "1"], "the shortest run of this rig takes 1.5 min"),
        (["--tell", "braid_friction"], "`--tell` takes two mechanisms"),
        (["--tell", "braid_friction", "viscous_damping"], "`--tell` takes a case folder with a recording"),
    ],
)
def test_a_bad_wish_is_refused(bench, tmp_path, capsys, words, told):
    arguments = ["plan", str(bench / "stated" / "muscle.toml"), "--out", str(tmp_path), *words]
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert told in said
    assert said.count("\n") == 1


@pytest.mark.parametrize(
    ("rig", "told"),
    [
        ("contraction = 1.5", "share below 0.9"),
        ("force_zero = 5", 'Write "5 N"'),
        ('speed = "0 mm/s"', "positive"),
    ],
)
def test_a_rig_that_cannot_be_is_refused(bench, tmp_path, capsys, rig, told):
    (tmp_path / "rig.toml").write_text(f"[rig]\n{rig}\n")
    words = [str(bench / "stated" / "muscle.toml"), str(tmp_path / "rig.toml"), "--out", str(tmp_path)]
    assert main(["plan", *words]) == 2
    assert told in capsys.readouterr().err


def test_a_table_without_time_tells_no_friction(capsys, tmp_path):
    words = ["--tell", "braid_friction", "viscous_damping", "--out", str(tmp_path)]
    assert main(["plan", PAPER, *words]) == 2
    assert "'braid_friction' needs time; got a table without time" in capsys.readouterr().err


@pytest.mark.slow
def test_a_tie_is_told_apart(diagnosed, bench, tmp_path, capsys):
    words = [str(bench / "rubbed"), "--tell", "braid_friction", "viscous_damping", "--out", str(tmp_path)]
    assert main(["plan", *words, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document == json.loads((tmp_path / "contest.json").read_text())
    assert [one["id"] for one in document["menu"]] == [f"X{k}" for k in range(1, 15)]
    assert document["next_experiment"]["power"] > 0.9
    assert document["explained"]
    page = Page((tmp_path / "report.html").read_text("utf-8"))
    rows = page.table(["", "what to do"])
    for one in document["menu"]:
        assert float(rows[one["id"]][1]) == pytest.approx(one["power"], abs=0.0051)
    assert len(page.every("svg")) == 2


@pytest.mark.slow
def test_a_recording_that_neither_explains_is_told_so_first(bench, tmp_path, capsys):
    spent = ["--with", "contact_pressure.threshold=60 kPa", "--seed", "3", "--out", str(tmp_path / "spent")]
    assert main(["simulate", str(bench / "stated"), str(bench / "plan.toml"), *spent]) == 0
    pair = ["--tell", "braid_friction", "viscous_damping"]
    words = [str(tmp_path / "spent"), *pair, "--out", str(tmp_path / "told")]
    assert main(["plan", *words]) == 0
    said = capsys.readouterr().out
    assert "neither braid_friction nor viscous_damping explains this recording" in said
    assert "  next: " not in said
    document = json.loads((tmp_path / "told" / "contest.json").read_text())
    assert not document["explained"]
    assert all(one["p_value"] < 1e-3 and one["rms_over_noise"] > 1.3 for one in document["left"].values())
    page = (tmp_path / "told" / "report.html").read_text("utf-8")
    assert "<h1>Neither braid_friction nor viscous_damping explains this recording</h1>" in page
