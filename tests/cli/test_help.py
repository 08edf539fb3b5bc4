"""Help pages: line width, and only options that exist."""

import re
from itertools import pairwise

import pytest

from pamjax.cli.import_example import IMPORT_EXAMPLE
from pamjax.cli.main import app, main
from pamjax.cli.size_example import SIZE_EXAMPLE

WORDS = [name for name in app if not name.startswith("-")]


def rows(words, capsys):
    """Return the lines within the boxes of a help page."""
    assert main([*words, "--help"]) == 0
    return [line.strip("│ ") for line in capsys.readouterr().out.splitlines() if line.startswith("│")]


@pytest.mark.parametrize("word", WORDS)
def test_paragraphs_fill_the_width(word, capsys):
    assert main([word, "--help"]) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("│")]
    for line, below in pairwise(lines):
        indent = re.match(r"│ +", below)
        goes_on = indent and len(indent[0]) > 5 and not below[len(indent[0]) :].startswith(("--", "["))
        if goes_on:
            free = len(line) - 2 - len(line[:-1].rstrip())
            assert free < 1 + len(below[len(indent[0]) :].split()[0]), (line, below)


@pytest.mark.parametrize("word", WORDS)
def test_help_has_no_option_for_empty_lists(word, capsys):
    assert not [row for row in rows([word], capsys) if "--empty" in row]


@pytest.mark.parametrize("word", ["simulate", "inverse", "validate"])
def test_help_lists_both_files_of_a_calibrated_muscle(word, capsys):
    text = " ".join(rows([word], capsys))
    assert "fit.json or model.json" in text or "a model.json of `pamjax diagnose`, or a fit.json" in text
    assert "name of the case, if a fit.json or model.json has several." in text


def test_help_explains_the_minutes(capsys):
    text = " ".join(rows(["plan"], capsys))
    assert "available time for all runs; by default that of the rig file, or 60." in text


def test_example_on_the_help_page_of_import_makes_a_case(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert main(["import", "--help"]) == 0
    page = capsys.readouterr().out
    assert IMPORT_EXAMPLE in page
    (header,) = re.findall("with the header `(.*)`", page)
    (command,) = re.findall("^Then run: pamjax (.*)$", page, re.M)
    (tmp_path / "run.csv").write_text(f"{header}\n0,0;2,000;200,0;775,8\n0,5;2,001;195,0;714,0\n")
    (tmp_path / "import.toml").write_text(IMPORT_EXAMPLE)
    assert main(["new", "mine"]) == 0
    assert main(command.split()) == 0, capsys.readouterr().err
    printed = capsys.readouterr().out
    assert "note: muscle.toml has the rest length and the braid of the template. Replace them" in printed
    rows = (tmp_path / "case" / "recording.csv").read_text("utf-8")
    assert "779.1" in rows
    assert "717.3" in rows
    muscle = tmp_path / "mine" / "muscle.toml"
    muscle.write_text(muscle.read_text("utf-8").replace('rest_length = "200 mm"', 'rest_length = "201 mm"'))
    assert main([*command.split()[:-1], "other"]) == 0
    assert "note:" not in capsys.readouterr().out


def test_example_on_the_help_page_of_size_is_a_feasible_spec(tmp_path, capsys):
    from pamjax.sizing.size import size

    assert main(["size", "--help"]) == 0
    page = capsys.readouterr().out
    assert SIZE_EXAMPLE in page
    assert "Then run: pamjax size spec.toml --out out/sized" in page
    (tmp_path / "spec.toml").write_text(SIZE_EXAMPLE)
    assert size(tmp_path / "spec.toml", starts=1, stock=False).feasible
