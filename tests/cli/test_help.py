"""Help pages: line width, and only options that exist."""

import re
from itertools import pairwise

import pytest

from pamjax.cli.main import app, main

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
