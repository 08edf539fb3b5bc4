"""Is what the pages show what happens? Every block of code on them runs."""

import re
from pathlib import Path

import pytest

import pamjax

ROOT = Path(__file__).parents[1]
PAGES = ["README.md", "docs/write-a-mechanism.md"]


def blocks(page, language):
    return re.findall(rf"^```{language}\n(.*?)^```", (ROOT / page).read_text(encoding="utf-8"), re.S | re.M)


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES)
def test_code_runs(page, monkeypatch):
    monkeypatch.chdir(ROOT)
    code = blocks(page, "python")
    assert code
    exec(compile("\n".join(code), page, "exec"), {"__name__": page.replace("/", ".")})


@pytest.mark.slow
def test_readme_shows_the_note_that_fit_prints():
    (shown,) = (b for b in blocks("README.md", "") if "thread.modulus" in b)
    note = str(pamjax.fit(pamjax.read_case(ROOT / "fits/chambers_wereley_2022")))
    assert _first_numbers(note) == _first_numbers(shown)


def test_readme_shows_the_verdict_that_the_tutorial_prints():
    (shown,) = (b for b in blocks("README.md", "text") if "baseline misses" in b)
    beyond = "  the highest isobar"  # the tutorial stops before
    lines = [line for line in shown.splitlines() if not line.startswith(beyond)]
    assert set(lines) <= set("".join(blocks("docs/tutorial.md", "text")).splitlines())


def _first_numbers(note):
    """Names with value and sd; the last digit of an rmse may differ between machines."""
    return re.findall(r"^  (\S+\.\S+)\s+([\d.]+ ± [\d.]+)", note, re.M)


def test_contributors_page_is_short():
    assert len((ROOT / "docs/write-a-mechanism.md").read_text(encoding="utf-8").splitlines()) < 60
