"""`pamjax plan`: a user without data is told what to do, what it costs and what one channel alone could."""

import json

import pandas as pd
import pytest

from pamjax.cli.main import main


@pytest.fixture(scope="module")
def planned(bench, tmp_path_factory):
    """The folder that `pamjax plan` wrote for a muscle.toml alone."""
    folder = tmp_path_factory.mktemp("plan")
    rig = folder / "rig.toml"
    rig.write_text('[rig]\npressure = "6 bar"\nforce = "2 N"\ndiameter = "0.1 mm"\n')
    words = [str(bench / "stated" / "muscle.toml"), str(rig), "--goal", "thread.modulus", "--to", "6 %"]
    assert main(["plan", *words, "--minutes", "40", "--out", str(folder / "out")]) == 0
    return folder / "out"


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


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--goal", "thread.modulos"], "Did you mean `thread.modulus`?"),
        (["--to", "5 N"], "has no"),
        (["--tell", "braid_friction"], "`--tell` takes two mechanisms"),
    ],
)
def test_a_bad_wish_is_refused(bench, tmp_path, capsys, words, told):
    arguments = ["plan", str(bench / "stated" / "muscle.toml"), "--out", str(tmp_path), *words]
    assert main(arguments) == 2
    said = capsys.readouterr().err
    assert told in said or "unit" in said
    assert said.count("\n") == 1
