"""`pamjax prove`: refusal of invalid options, and its table and figures."""

import json

import pytest

import pamjax.benchmark.bank_trial
import pamjax.benchmark.trial
from pamjax.cli.main import main
from pamjax.records.case import read_case
from tests.benchmark.test_bank_trial import make_up
from tests.benchmark.trials import made_up


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--correlation", "0.5", "--correlation", "2"], "`correlation` must be between 0 and 0.95; got 2."),
        (["--pair", "-1"], "`pair` must be at least 0; got -1."),
        (["--workers", "0"], "`workers` must be at least 1; got 0."),
        (["--stage", "half"], "--stage"),
        (["--mixed", "2"], "`--mixed` needs the bank of other forms. Add --bank other-forms."),
        (["--write", "x"], "`--write` needs the bank of other forms. Add --bank other-forms."),
        (
            ["--bank", "other-forms", "--stage", "score"],
            "`--stage score` is not possible with the bank of other forms.",
        ),
        (
            ["--bank", "other-forms", "--form-error", "0.1"],
            "`--form-error` is not possible with the bank of other forms.",
        ),
    ],
)
def test_invalid_options_give_one_error_line(words, message, capsys, tmp_path):
    assert main(["prove", "--out", str(tmp_path / "out"), *words]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_prove_writes_trials_table_and_figures(capsys, tmp_path, monkeypatch):
    run_tasks = []
    monkeypatch.setattr(
        pamjax.benchmark.trial,
        "run_trial",
        lambda task: run_tasks.append(task) or made_up(task),
        raising=True,
    )
    words = ["prove", "--out", str(tmp_path), "--nothing", "6", "--single", "4", "--correlation", "0.9"]
    assert main(words) == 0
    assert "noise correlation 0.9, whole diagnosis: any alarm" in capsys.readouterr().out
    assert len(run_tasks) == len((tmp_path / "trials.jsonl").read_text().splitlines()) == 11
    message = json.loads((tmp_path / "table.json").read_text())
    assert all({"what", "pamjax", "common_practice", "aim"} <= row.keys() for row in message)
    assert {"table.md", "table.csv", "nothing.png", "recovery.png"} <= {p.name for p in tmp_path.iterdir()}
    # A second run with a lower number computes nothing, and the table still has all trials.
    assert main([*words[:3], "--single", "1", "--outside", "0", "--correlation", "0.9", "--json"]) == 0
    assert len(run_tasks) == 11
    assert {row["what"]: row["of"] for row in json.loads(capsys.readouterr().out) if "of" in row}
    assert json.loads((tmp_path / "table.json").read_text()) == message


def test_prove_grades_the_bank_of_other_forms(capsys, tmp_path, monkeypatch):
    run_tasks = []
    monkeypatch.setattr(
        pamjax.benchmark.bank_trial, "run_bank_trial", lambda task: run_tasks.append(task) or make_up(task)
    )
    words = ["prove", "--bank", "other-forms", "--out", str(tmp_path), "--single", "4", "--mixed", "1"]
    assert main(words) == 0
    assert "recall, effects in another form" in capsys.readouterr().out
    assert [task.kind for task in run_tasks].count("mixed") == 1
    tables = {"trials.jsonl", "table.md", "table.csv", "table.json"}
    assert {p.name for p in tmp_path.iterdir()} == tables | {"reliability.png", "reliability.pdf"}


def test_prove_writes_the_recordings_of_the_bank(capsys, tmp_path):
    words = ["prove", "--bank", "other-forms", "--outside", "0", "--write", str(tmp_path / "bank")]
    assert main([*words, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["recordings"] == 3
    key = json.loads((tmp_path / "bank" / "key.json").read_text())["cases"]
    assert sorted(case["kind"] for case in key.values()) == ["nothing", "single", "single"]
    assert all(read_case(tmp_path / "bank" / name).recording.n == case["rows"] for name, case in key.items())
    assert main(words) == 2
    assert "must be a new or an empty folder" in capsys.readouterr().err
