"""`pamjax prove` refuses what it cannot do, and writes the same table in three forms and two figures."""

import json

import pytest

import pamjax.benchmark.trial
from pamjax.cli.main import main
from tests.benchmark.trials import made_up


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--correlation", "0.5", "--correlation", "2"], "`correlation` must lie between 0 and 0.95; got 2."),
        (["--pair", "-1"], "`pair` must be at least 0; got -1."),
        (["--workers", "0"], "`workers` must be at least 1; got 0."),
        (["--stage", "half"], "--stage"),
    ],
)
def test_wrong_words_leave_one_sentence(words, told, capsys, tmp_path):
    assert main(["prove", "--out", str(tmp_path / "out"), *words]) == 2
    assert told in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_a_proof_writes_trials_a_table_and_figures(capsys, tmp_path, monkeypatch):
    asked = []
    monkeypatch.setattr(
        pamjax.benchmark.trial, "run_trial", lambda task: asked.append(task) or made_up(task), raising=True
    )
    words = ["prove", "--out", str(tmp_path), "--nothing", "6", "--single", "4", "--correlation", "0.9"]
    assert main(words) == 0
    assert "noise 0.9, whole pipeline: an alarm of any kind" in capsys.readouterr().out
    assert len(asked) == len((tmp_path / "trials.jsonl").read_text().splitlines()) == 11
    told = json.loads((tmp_path / "table.json").read_text())
    assert all({"what", "pamjax", "common_practice", "aim"} <= row.keys() for row in told)
    assert {"table.md", "table.csv", "nothing.png", "recovery.png"} <= {p.name for p in tmp_path.iterdir()}
    # Asked again for less, nothing is done again, and the table is still of all there is.
    assert main([*words[:3], "--single", "1", "--outside", "0", "--correlation", "0.9", "--json"]) == 0
    assert len(asked) == 11
    assert {row["what"]: row["of"] for row in json.loads(capsys.readouterr().out) if "of" in row}
    assert json.loads((tmp_path / "table.json").read_text()) == told
