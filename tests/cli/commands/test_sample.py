"""`pamjax sample`: posterior of a case on disk, without new steps in a second run."""

import errno
import json
from pathlib import Path

import pytest

from pamjax.cli.main import main

PAPER = str(Path(__file__).parents[3] / "fits/chambers_wereley_2022")


@pytest.mark.slow
def test_posterior_is_written_and_reused(tmp_path, capsys):
    priors = tmp_path / "priors.toml"
    priors.write_text('["thread.modulus"]\nvalue = "90 GPa"\nsd = "10 GPa"\n')
    words = ["sample", PAPER, "--out", str(tmp_path / "out"), "--ess", "200", "--rhat", "1.1", "--no-figures"]
    words += ["--priors", str(priors)]
    assert main(words) == 0
    output = capsys.readouterr()
    assert "thread.modulus: 90 ± 10 GPa (replaces that of muscle.toml)" in output.out
    assert "wrote" in output.err
    chain = {path.name for path in (tmp_path / "out" / "chain").iterdir()}
    document = json.loads((tmp_path / "out" / "posterior.json").read_text())
    assert document["parameters"]["thread.modulus"]["verdict"] == "determined by the data"
    assert main([*words, "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == document
    assert {path.name for path in (tmp_path / "out" / "chain").iterdir()} == chain
    assert main([*words[:-2]]) == 2
    assert "can only be resumed with the same priors; got other priors" in capsys.readouterr().err


@pytest.mark.slow
def test_full_disk_keeps_the_earlier_results_together(tmp_path, monkeypatch, capsys):
    words = ["sample", PAPER, "--out", str(tmp_path), "--ess", "50", "--rhat", "1.5", "--no-figures"]
    assert main(words) == 0
    files = {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in tmp_path.glob("*.*")}
    assert {path.name for path in files} == {"posterior.json", "posterior.nc", "report.html"}

    def raise_full_disk(*_):
        raise OSError(errno.ENOSPC, "No space left on device", "report.html")

    monkeypatch.setattr("pamjax.view.reports.posterior.write_posterior_report", raise_full_disk)
    capsys.readouterr()
    assert main(words) == 2
    assert capsys.readouterr().err.endswith(
        "pamjax: cannot read or write a file: No space left on device (report.html). Use another path.\n"
    )
    assert {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in tmp_path.glob("*.*")} == files


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "value = 3",
            "a prior is a table with the name of its parameter in quotes; got value in priors.toml",
        ),
        (
            "[thread.modulus]\nsd = 1",
            "a prior is a table with the name of its parameter in quotes; got thread",
        ),
        (
            '["thread.modulo"]\nsd = 1',
            "unknown parameter 'thread.modulo'. Did you mean `thread.modulus`?",
        ),
        ('["thread.modulus"]\nmean = 1', "a prior has no entry 'mean'; got [thread.modulus] in priors.toml"),
        ('["thread.modulus"]\nsd = "3 mm"', "unit"),
        ('["thread.modulus"]\nsd = "-1 GPa"', "`sd` of a prior must be positive; got -1 GPa"),
        (
            '["thread.modulus"]\nsd = 5',
            "this value needs a unit; got '5' in [thread.modulus] of priors.toml.",
        ),
        ("=", "must be TOML; got"),
    ],
)
def test_invalid_prior_is_refused(tmp_path, capsys, text, message):
    (tmp_path / "priors.toml").write_text(text)
    words = ["sample", PAPER, "--out", str(tmp_path / "out"), "--priors", str(tmp_path / "priors.toml")]
    assert main(words) == 2
    assert message in capsys.readouterr().err


def test_memory_options_are_those_of_fit(tmp_path, capsys):
    words = ["sample", PAPER, "--out", str(tmp_path / "out"), "--gaps", "never"]
    assert main(words) == 2
    assert "`gaps` must be carry or anew; got 'never'" in capsys.readouterr().err
