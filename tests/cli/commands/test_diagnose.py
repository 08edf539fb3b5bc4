"""`pamjax diagnose`: its files, and their agreement."""

import json
import shlex

import numpy as np
import pandas as pd
import pytest

from pamjax.cli.commands.diagnose import _format_closing_lines
from pamjax.cli.main import main
from pamjax.errors import BadInput
from tests.view.html_page import Page
from tests.view.made_up import diagnosis, planned


@pytest.mark.slow
def test_friction_is_named_in_the_report(diagnosed):
    document = json.loads((diagnosed / "diagnosis.json").read_text())
    assert [name["id"] for name in document["missing_physics"]] == ["braid_friction"]
    page = Page((diagnosed / "report.html").read_text("utf-8"))
    assert "Missing from the baseline: friction between braid threads" in page.text
    coefficient = document["missing_physics"][0]["parameters"]["coefficient"]
    value, sd = page.table(["parameter", "value"])["coefficient"][0].split(" ± ")
    assert float(value) == pytest.approx(coefficient["value"], abs=0.06 * coefficient["sd"])
    assert float(sd) == pytest.approx(coefficient["sd"], rel=0.05)
    assert f"pamjax diagnose {diagnosed.parents[1] / 'rubbed'} --out" in page.text


@pytest.mark.slow
def test_misfit_can_be_recomputed_from_the_files(diagnosed):
    document = json.loads((diagnosed / "diagnosis.json").read_text())["improvement"]["held_out"]["force"]
    predicted = pd.read_csv(diagnosed / "prediction.csv")
    measured = pd.read_csv(diagnosed.parents[1] / "rubbed" / "recording.csv", comment="#")["force [N]"]
    out = predicted["held_out"].to_numpy(bool)
    assert 0 < out.sum() < len(out)
    for when in ("before", "after"):
        misfit = (measured - predicted[f"force_{when} [N]"])[out]
        assert np.sqrt(np.mean(misfit**2)) == pytest.approx(document[f"rmse_{when}"], rel=1e-3)
    assert document["rmse_after"] < 0.5 * document["rmse_before"]


@pytest.mark.parametrize("wanted", [pytest.param(True, marks=pytest.mark.slow), False])
def test_report_is_optional(wanted, bench, tmp_path, monkeypatch, capsys):
    result = diagnosis()
    monkeypatch.setattr(
        "pamjax.diagnosis.batch.diagnose_all", lambda cases, **_: [(result.problem.case, result)]
    )
    # An artificial diagnosis has no model to refit: its earlier prediction replaces the held-out fit.
    monkeypatch.setattr(
        "pamjax.baselines.comparison._predict_without_rows",
        lambda diagnosis_result, out: (
            diagnosis_result.held_out_errors.baseline_prediction,
            diagnosis_result.held_out_errors.model_prediction,
        ),
    )
    option = ["--report"] if wanted else ["--no-report"]
    words = ["diagnose", str(bench / "made"), "--out", str(tmp_path), *option]
    assert main(words) == 0
    names = ["diagnosis.json", "prediction.csv", "model.json", "gain.json"] + ["report.html"] * wanted
    assert {path.name for path in (tmp_path / "bench").iterdir()} == set(names)
    printed = capsys.readouterr()
    assert f"wrote {tmp_path}/bench/: {', '.join(names)}" in printed.err
    assert "Sárosi" in printed.out
    folder = tmp_path / "bench"
    assert printed.out.splitlines()[-2:] == [
        f"results: {folder / ('report.html' if wanted else 'diagnosis.json')}",
        f"next: Test the model on another recording: `pamjax validate {folder}/model.json OTHER`.",
    ]
    if wanted:
        page = Page((tmp_path / "bench" / "report.html").read_text("utf-8"))
        assert "empirical formula and a Gaussian process" in page.text
        assert f"pamjax {shlex.join(words)}" in page.text
        # The report's commands work where this command was run.
        assert page.text.count(f"pamjax validate {folder}/model.json OTHER") == 2
        assert f"pamjax inverse {folder}/model.json --force" in page.text


def test_next_step_is_the_experiment_of_the_summary(tmp_path):
    lines = _format_closing_lines(diagnosis(experiments=(planned(),)), tmp_path, report=True)
    assert lines[-1] == "next: run the experiment above, and diagnose its recording"


def test_next_command_quotes_its_path(tmp_path):
    *_, line = _format_closing_lines(diagnosis(), tmp_path / "my bench", report=True)
    assert f"'{tmp_path / 'my bench'}/model.json'" in line


def test_invalid_cases_are_reported_and_the_others_are_diagnosed(bench, tmp_path, monkeypatch, capsys):
    result = diagnosis()
    printed_before = []

    def answer(cases, **_):
        printed_before.append(capsys.readouterr().err)
        yield (
            result.problem.case,
            BadInput.from_rule("a diagnosis needs more rows", "3", str(tmp_path), "Record more."),
        )
        yield result.problem.case, result

    monkeypatch.setattr("pamjax.diagnosis.batch.diagnose_all", answer)
    folders = [str(tmp_path / "none"), str(tmp_path / "neither"), str(bench / "made")]
    out = tmp_path / "out"
    assert main(["diagnose", *folders, "--out", str(out), "--no-report", "--no-beside"]) == 2
    assert f"pamjax: {folders[0]}: " in printed_before[0]
    assert f"pamjax: {folders[1]}: " in printed_before[0]
    printed = capsys.readouterr()
    assert f"pamjax: {result.problem.case.folder}: a diagnosis needs more rows" in printed.err
    assert (out / "bench" / "diagnosis.json").exists()
    assert "bench" in printed.out


def test_an_unreadable_case_is_reported_once(bench, tmp_path, monkeypatch, capsys):
    result = diagnosis()
    monkeypatch.setattr(
        "pamjax.diagnosis.batch.diagnose_all", lambda *_, **__: [(result.problem.case, result)]
    )
    folders, out = [str(tmp_path / "none"), str(bench / "made")], str(tmp_path / "out")
    assert main(["diagnose", *folders, "--out", out, "--no-report", "--no-beside"]) == 2
    errors = capsys.readouterr().err
    assert errors.count("a case must be a folder") == 1
    assert "1 of 2 cases not diagnosed: see the messages above" in errors
