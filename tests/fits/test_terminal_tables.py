"""Tables of the article in a terminal are split if they are too wide, without truncated values."""

import io

import pandas as pd
import pytest
from rich.console import Console

from tests.fits.scripts import import_scripts


@pytest.mark.parametrize("width", [50, 80, 170])
def test_no_value_is_truncated(width):
    frame = pd.DataFrame({"kind of thread": ["Kevlar-49, as printed in the article", "PET"]})
    for k in range(9):
        frame[f"thread_stretch_{k} [percent]"] = [1234.5 + k, -0.25 - k]
    with import_scripts("chambers_wereley_2022", "case") as (script,):
        parts = script.split_table("Many columns", frame, width, "at the end")
    console = Console(width=width, record=True, file=io.StringIO())
    console.print(*parts, sep="\n")
    text = console.export_text()
    assert "…" not in text
    assert max(map(len, text.splitlines())) <= width
    numbers = [f"{x:.2f}" for k in range(9) for x in (1234.5 + k, -0.25 - k)]
    assert all(number in text for number in numbers)
    assert (len(parts) == 1) == (width == 170)
    assert text.count("PET") == len(parts)
    assert text.count("(continued)") == len(parts) - 1
    assert text.count("at the end") == 1
