"""Help pages: paragraphs fill the width, and no option is there that nobody wrote."""

import re
from itertools import pairwise

import pytest

from pamjax.cli.main import app, main

WORDS = [name for name in app if not name.startswith("-")]


def rows(words, capsys):
    """What stands in the boxes of a help page, line by line."""
    assert main([*words, "--help"]) == 0
    return [line.strip("│ ") for line in capsys.readouterr().out.splitlines() if line.startswith("│")]


@pytest.mark.parametrize("word", WORDS)
def test_a_line_ends_where_the_next_word_would_not_fit(word, capsys):
    assert main([word, "--help"]) == 0
    lines = [line for line in capsys.readouterr().out.splitlines() if line.startswith("│")]
    for line, below in pairwise(lines):
        blank = re.match(r"│ +", below)
        goes_on = blank and len(blank[0]) > 5 and not below[len(blank[0]) :].startswith(("--", "["))
        if goes_on:
            free = len(line) - 2 - len(line[:-1].rstrip())
            assert free < 1 + len(below[len(blank[0]) :].split()[0]), (line, below)


@pytest.mark.parametrize("word", WORDS)
def test_no_list_is_made_empty(word, capsys):
    assert not [row for row in rows([word], capsys) if "--empty" in row]


@pytest.mark.parametrize("word", ["simulate", "inverse", "validate"])
def test_a_calibrated_muscle_is_either_file(word, capsys):
    said = " ".join(rows([word], capsys))
    assert "fit.json or model.json" in said or "a model.json of `pamjax diagnose`, or a fit.json" in said
    assert "which case of a fit.json or model.json with several." in said


def test_minutes_say_what_they_are(capsys):
    said = " ".join(rows(["plan"], capsys))
    assert "time that there is for all runs; the rig's if left out, or 60." in said
