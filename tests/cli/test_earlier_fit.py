"""`pamjax fit` replaces the files of an earlier fit in its folder, and no other file."""

import json
import os
from datetime import datetime

import pytest

from pamjax.cli.earlier_fit import describe_earlier_fit, list_earlier_files
from pamjax.cli.main import main
from pamjax.infer.fitting.io import FIT_SCHEMA

FIT_PAGE = '<p class="kicker">Fit of other · elastic threads</p>'


@pytest.fixture
def folder(tmp_path):
    """Return a folder with the fit of two cases, and files of the user and of another command."""
    document = {"schema": FIT_SCHEMA, "cases": {"a": {}, "../b": {}}}
    (tmp_path / "fit.json").write_text(json.dumps(document))
    for name in ("a.nc", "a-residual.png", "prior.png", "notes.txt", "my-residual.png", "residual.png"):
        (tmp_path / name).write_text("old")
    (tmp_path / "report.html").write_text(FIT_PAGE)
    (tmp_path.parent / "b.nc").write_text("outside the folder")
    return tmp_path


def test_files_of_an_earlier_fit_are_listed(folder):
    assert list_earlier_files(folder) == ["fit.json", "a.nc", "prior.png", "a-residual.png", "report.html"]
    (folder / "report.html").write_text(FIT_PAGE.replace("Fit of", "Posterior of"))
    assert "report.html" not in list_earlier_files(folder)


@pytest.mark.parametrize("text", [None, "{", "[]", '{"schema": "mine", "cases": {"a": 1}}'])
def test_files_without_an_earlier_fit_are_not_listed(text, folder):
    (folder / "fit.json").unlink()
    if text is not None:
        (folder / "fit.json").write_text(text)
    assert list_earlier_files(folder) == []
    assert describe_earlier_fit(folder) == ""


def test_earlier_fit_is_described_with_its_options_and_time(folder):
    document = {
        "schema": FIT_SCHEMA,
        "law": "elastic",
        "mechanisms": ["bladder_elasticity", "force_offset"],
        "loss": "soft",
        "cases": {"mine": {"form_errors": {"bladder_elasticity": {}}}},
    }
    (folder / "fit.json").write_text(json.dumps(document))
    time = datetime(2026, 11, 28, 9, 5).timestamp()
    os.utime(folder / "fit.json", (time, time))
    options = "--law elastic --with bladder_elasticity force_offset --loss soft --form-error"
    assert describe_earlier_fit(folder) == f"mine {options}, written 2026-11-28 09:05"


def test_fit_removes_only_the_files_of_an_earlier_fit(bench, folder, capsys):
    words = ["--out", str(folder), "--starts", "1", "--folds", "2", "--no-figures", "--no-report"]
    assert main(["fit", str(bench / "made"), *words]) == 0
    names = {path.name for path in folder.iterdir()}
    assert names == {"fit.json", "fit.nc", "notes.txt", "my-residual.png", "residual.png"}
    assert (folder.parent / "b.nc").exists()
    removed, printed = "a.nc, prior.png, a-residual.png, report.html", capsys.readouterr().err
    assert f"removed files of an earlier fit from {folder}/: {removed}" in printed
    assert f"replaced the earlier fit in {folder}/: a, ../b, written " in printed
    for path in folder.iterdir():
        path.unlink()
    assert main(["fit", str(bench / "made"), *words]) == 0
    assert "replaced" not in capsys.readouterr().err
