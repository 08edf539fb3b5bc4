"""`pamjax diagnose`: what it writes, and that its files say the same."""

import json

import numpy as np
import pandas as pd
import pytest

from pamjax.cli.main import main
from pamjax.errors import refuse
from tests.view.html_page import Page
from tests.view.made_up import diagnosis


@pytest.mark.slow
def test_friction_is_named_and_the_report_says_so(diagnosed):
    told = json.loads((diagnosed / "diagnosis.json").read_text())
    assert [name["id"] for name in told["missing_physics"]] == ["braid_friction"]
    page = Page((diagnosed / "report.html").read_text("utf-8"))
    assert "Left out: friction between braid threads" in page.text
    coefficient = told["missing_physics"][0]["parameters"]["coefficient"]
    value, sd = page.table(["number", "value"])["coefficient"][0].split(" ± ")
    assert float(value) == pytest.approx(coefficient["value"], abs=0.06 * coefficient["sd"])
    assert float(sd) == pytest.approx(coefficient["sd"], rel=0.05)
    assert f"pamjax diagnose {diagnosed.parents[1] / 'rubbed'} --out" in page.text


@pytest.mark.slow
def test_anyone_can_recompute_the_claim(diagnosed):
    told = json.loads((diagnosed / "diagnosis.json").read_text())["improvement"]["held_out"]["force"]
    predicted = pd.read_csv(diagnosed / "prediction.csv")
    measured = pd.read_csv(diagnosed.parents[1] / "rubbed" / "recording.csv")["force [N]"]
    out = predicted["held_out"].to_numpy(bool)
    assert 0 < out.sum() < len(out)
    for when in ("before", "after"):
        misfit = (measured - predicted[f"force_{when} [N]"])[out]
        assert np.sqrt(np.mean(misfit**2)) == pytest.approx(told[f"rmse_{when}"], rel=1e-3)
    assert told["rmse_after"] < 0.5 * told["rmse_before"]


@pytest.mark.parametrize("wanted", [True, False])
def test_the_report_is_written_unless_it_is_not_wanted(wanted, bench, tmp_path, monkeypatch, capsys):
    found = diagnosis()
    monkeypatch.setattr(
        "pamjax.diagnosis.batch.diagnose_all", lambda cases, **_: [(found.problem.case, found)]
    )
    # A made-up diagnosis has no model to refit: what it showed before stands for the fit without some rows.
    monkeypatch.setattr(
        "pamjax.baselines.comparison._predict_without_rows",
        lambda one, out: (one.gain.before, one.gain.after),
    )
    option = [] if wanted else ["--no-report"]
    assert main(["diagnose", str(bench / "made"), "--out", str(tmp_path), *option]) == 0
    names = ["diagnosis.json", "prediction.csv", "model.json", "gain.json"] + ["report.html"] * wanted
    assert {path.name for path in (tmp_path / "bench").iterdir()} == set(names)
    shown = capsys.readouterr()
    assert f"wrote {tmp_path}/bench/: {', '.join(names)}" in shown.err
    assert "Sárosi" in shown.out
    if wanted:
        assert "a flexible curve" in (tmp_path / "bench" / "report.html").read_text("utf-8")


def test_bad_cases_are_told_by_their_folders_and_hide_no_good_one(bench, tmp_path, monkeypatch, capsys):
    found = diagnosis()
    told_before = []

    def answer(cases, **_):
        told_before.append(capsys.readouterr().err)
        yield found.problem.case, refuse("a diagnosis needs more rows", "3", str(tmp_path), "Record more.")
        yield found.problem.case, found

    monkeypatch.setattr("pamjax.diagnosis.batch.diagnose_all", answer)
    folders = [str(tmp_path / "none"), str(tmp_path / "neither"), str(bench / "made")]
    out = tmp_path / "out"
    assert main(["diagnose", *folders, "--out", str(out), "--no-report", "--no-beside"]) == 2
    assert f"pamjax: {folders[0]}: " in told_before[0]
    assert f"pamjax: {folders[1]}: " in told_before[0]
    shown = capsys.readouterr()
    assert f"pamjax: {found.problem.case.folder}: a diagnosis needs more rows" in shown.err
    assert (out / "bench" / "diagnosis.json").exists()
    assert "bench" in shown.out
