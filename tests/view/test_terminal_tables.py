"""Tables of the article in a terminal: split where they are too wide, and no number is ever cut."""

import importlib
import io
import sys
from pathlib import Path

import pandas as pd
import pytest
from rich.console import Console

FOLDER = Path(__file__).parents[2] / "fits" / "chambers_wereley_2022"
OURS = ("case", "figures", "tables")


@pytest.fixture
def lines(monkeypatch):
    """Of the case folder, which is no package."""
    monkeypatch.syspath_prepend(FOLDER)
    for name in OURS:
        monkeypatch.delitem(sys.modules, name, raising=False)
    yield importlib.import_module("case").lines
    for name in OURS:
        sys.modules.pop(name, None)


@pytest.mark.parametrize("width", [50, 80, 170])
def test_no_number_is_cut(lines, width):
    frame = pd.DataFrame({"kind of thread": ["Kevlar-49, as printed in the article", "PET"]})
    for k in range(9):
        frame[f"thread_stretch_{k} [percent]"] = [1234.5 + k, -0.25 - k]
    parts = lines("Many columns", frame, width, "at the end")
    show = Console(width=width, record=True, file=io.StringIO())
    show.print(*parts, sep="\n")
    text = show.export_text()
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= width
    numbers = [f"{x:.2f}" for k in range(9) for x in (1234.5 + k, -0.25 - k)]
    assert all(number in text for number in numbers)
    assert (len(parts) == 1) == (width == 170)
    assert text.count("PET") == len(parts)
    assert text.count("(continued)") == len(parts) - 1
    assert text.count("at the end") == 1
