"""A command replaces only files that pamjax wrote."""

import json

import numpy as np
import pytest

from pamjax.cli.main import main
from pamjax.cli.overwrite import check_replaceable
from pamjax.errors import BadInput

NAMES = ["fit.json", "report.html", "prediction.png"]
#: Command, option of its folder, file below this folder, and other options.
RUNS = {
    "fit": ("fit made", "--out", "report.html", []),
    "figure": ("fit made", "--out", "residual.png", ["--no-report"]),
    "foreign result": ("fit made", "--out", "fit.json", ["--no-report", "--no-figures"]),
    "sample": ("sample made", "--out", "ridge.png", []),
    "diagnose": ("diagnose made", "--out", "made/prediction.csv", []),
    "plan": ("plan made", "--out", "schedule.csv", []),
    "tell": ("plan made", "--out", "report.html", ["--distinguish", "braid_friction", "viscous_damping"]),
    "size": ("size plan.toml", "--out", "muscle/muscle.toml", []),
    "inverse": ("inverse stated", "--export", "controller.py", []),
    "prove": ("prove", "--out", "table.csv", []),
}


@pytest.mark.parametrize("run", RUNS)
def test_file_of_the_user_is_kept_and_refused_before_the_computation(run, bench, tmp_path, capsys):
    words, option, name, options = RUNS[run]
    command, *paths = words.split()
    file = tmp_path / "mydata" / name
    file.parent.mkdir(parents=True)
    file.write_text("mine")
    before = sorted(tmp_path.rglob("*"))
    arguments = [*(str(bench / path) for path in paths), option, str(tmp_path / "mydata"), *options]
    assert main([command, *arguments]) == 2
    assert capsys.readouterr().err.splitlines()[-1] == (
        f"pamjax: a command must replace only files that pamjax wrote; got {file}, which is another file."
        f" Write `{option}` with another folder, or rename the file."
    )
    assert file.read_text() == "mine"
    assert sorted(tmp_path.rglob("*")) == before


def test_files_that_the_command_does_not_write_are_no_obstacle(bench, tmp_path):
    (tmp_path / "report.html").write_text("mine")
    words = ["--out", str(tmp_path), "--starts", "1", "--folds", "2", "--no-figures", "--no-report"]
    assert main(["fit", str(bench / "made"), *words]) == 0
    assert (tmp_path / "report.html").read_text() == "mine"


def test_results_of_an_earlier_run_are_replaced(fitted, bench):
    words = ["--out", str(fitted), "--starts", "2", "--folds", "2"]
    assert main(["fit", str(bench / "made"), *words]) == 0


def test_report_of_another_command_is_replaced(tmp_path):
    (tmp_path / "report.html").write_text('<p class="kicker">Posterior of mine</p>')
    check_replaceable(tmp_path, NAMES)
    (tmp_path / "prediction.png").write_bytes(b"mine")
    with pytest.raises(BadInput, match=r"prediction\.png"):
        check_replaceable(tmp_path, NAMES)
    (tmp_path / "fit.json").write_text(json.dumps({"schema": "pamjax.fit/1"}))
    check_replaceable(tmp_path, NAMES)


@pytest.mark.parametrize("text", ["{", "[]", '{"schema": 1}', '{"schema": "mine"}', ""])
def test_other_json_is_no_result(text, tmp_path):
    (tmp_path / "fit.json").write_text(text)
    with pytest.raises(BadInput, match=r"fit\.json"):
        check_replaceable(tmp_path, NAMES)


def test_tables_for_a_controller_are_recognised(tmp_path):
    names = ["controller.npz", "controller.py"]
    (tmp_path / "controller.py").write_text("")
    np.savez(tmp_path / "controller.npz", error_force=1.0)
    check_replaceable(tmp_path, names)
    for damaged in (lambda file: np.savez(file, mine=1.0), lambda file: file.write_text("mine")):
        damaged(tmp_path / "controller.npz")
        with pytest.raises(BadInput, match=r"controller\.npz"):
            check_replaceable(tmp_path, names)


def test_trials_of_a_study_are_recognised(tmp_path):
    names = ["trials.jsonl", "table.csv"]
    (tmp_path / "table.csv").write_text("kind")
    (tmp_path / "trials.jsonl").write_text('{"stage": "all", "kind": "single"}\n')
    check_replaceable(tmp_path, names)
    (tmp_path / "trials.jsonl").write_text("1 2 3\n")
    with pytest.raises(BadInput, match=r"trials\.jsonl"):
        check_replaceable(tmp_path, names)


def test_a_page_of_the_user_beside_results_is_kept(tmp_path):
    (tmp_path / "fit.json").write_text('{"schema": "pamjax.fit/1"}')
    (tmp_path / "force.png").write_bytes(b"earlier figure")
    check_replaceable(tmp_path, ["fit.json", "report.html", "force.png"])
    (tmp_path / "report.html").write_text("<p>my notes</p>")
    with pytest.raises(BadInput, match=r"report\.html"):
        check_replaceable(tmp_path, ["fit.json", "report.html", "force.png"])
