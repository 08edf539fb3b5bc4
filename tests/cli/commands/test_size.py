"""`pamjax size`: files, text report, result of an infeasible spec, and message for an invalid spec."""

import json

import pytest

from pamjax.cli.main import main
from tests.view.html_page import Page

SPEC = """\
name = "small"
minimise = "mass"
[supply]
pressure = "5 bar"
[[force]]
at_least = "{force}"
contraction = 0.1
[envelope]
length = "200 mm"
diameter = "30 mm"
[threads]
kinds = "aramid"
counts = [48, 72]
diameters = "0.3 mm"
[bladders]
kinds = "latex"
"""


@pytest.mark.slow
def test_chosen_muscle_can_be_simulated(tmp_path, capsys):
    (tmp_path / "spec.toml").write_text(SPEC.format(force="200 N"))
    out = tmp_path / "out"
    assert main(["size", str(tmp_path / "spec.toml"), "--out", str(out), "--starts", "2"]) == 0
    note = capsys.readouterr().out
    assert note.startswith("small: ")
    assert len(note.splitlines()) < 25
    document = json.loads((out / "design.json").read_text())
    assert document["feasible"]
    page = Page((out / "report.html").read_text("utf-8"))
    assert sum(tag == "svg" for tag, _ in page.elements) >= 4
    assert {"chart.png", "sensitivities.png"} <= {path.name for path in out.iterdir()}
    assert "--starts 2" in page.text
    assert main(["simulate", str(out / "muscle"), "--out", str(tmp_path / "stated")]) == 0
    assert "the rubber of [bladder] is neglected" in capsys.readouterr().err
    assert main(["simulate", str(out / "model.json"), "--out", str(tmp_path / "whole")]) == 0
    assert "rubber" not in capsys.readouterr().err
    contracted = f"{950 * document['muscle']['rest_length']:.6f} mm"
    wish = ["inverse", str(out / "model.json"), "--length", contracted, "--json"]
    assert main([*wish, "--force", "150 N"]) == 0
    assert json.loads(capsys.readouterr().out)["limit"] == "OK"
    # The design is valid up to the supply pressure.
    assert main([*wish, "--force", "1 kN"]) == 0
    refused = json.loads(capsys.readouterr().out)
    assert refused["limit"] == "TOO_STRONG"
    assert refused["value"] == pytest.approx(500e3)
    assert main(["inverse", str(out / "design.json"), "--force", "1 N", "--length", "180 mm"]) == 2
    assert "Use the model.json in the same folder" in capsys.readouterr().err

    (tmp_path / "spec.toml").write_text(SPEC.format(force="200 kN"))
    assert (
        main(
            [
                "size",
                str(tmp_path / "spec.toml"),
                "--out",
                str(tmp_path / "no"),
                "--starts",
                "2",
                "--no-stock",
            ]
        )
        == 0
    )
    assert "no muscle of this catalogue meets all requirements" in capsys.readouterr().out
    assert not (tmp_path / "no" / "model.json").exists()
    assert json.loads((tmp_path / "no" / "design.json").read_text())["would_have_to_give"]


def test_folder_and_other_words_are_refused_with_a_remedy(tmp_path, capsys):
    assert main(["size", str(tmp_path)]) == 2
    assert "must be a file; got a folder. State the path of a file." in capsys.readouterr().err
    (tmp_path / "spec.toml").write_text('minimise = "weight"\n[supply]\npressure = "4 bar"\n')
    assert main(["size", str(tmp_path / "spec.toml")]) == 2
    assert "Did you mean `mass`?" in capsys.readouterr().err


def test_invalid_spec_gives_one_error_line(tmp_path, capsys):
    (tmp_path / "spec.toml").write_text(SPEC.format(force="200 kg"))
    assert main(["size", str(tmp_path / "spec.toml"), "--out", str(tmp_path / "out")]) == 2
    printed = capsys.readouterr()
    (line,) = printed.err.splitlines()
    assert "a force must have a unit of force; got 'kg' in [force] at_least of spec.toml" in line
    assert not (tmp_path / "out").exists()
