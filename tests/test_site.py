"""The documentation site builds without a warning, and its pages show the real output."""

import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from pamjax.cli.main import main

ROOT = Path(__file__).resolve().parents[1]
DOCS = ROOT / "docs"
FENCE = re.compile(r"^```(\{code-block\} )?(\w+)\n((?::\w+: [^\n]*\n)*)(.*?)^```", re.S | re.M)
CAPTION = re.compile(r":caption: (\S+)")


def steps(page):
    """Yield (kind, text) of each step of a page: file to write, command, expected output, or Python code."""
    for _, language, options, body in FENCE.findall((DOCS / page).read_text("utf-8")):
        named = CAPTION.search(options)
        if named:
            yield named[1], body
        elif language == "console":
            yield from (("$", line[2:]) for line in body.splitlines() if line.startswith("$ "))
        elif language in ("python", "text"):
            yield language, body


#: Pages whose code runs elsewhere: in `test_docs.py`, and in the build of the site.
ELSEWHERE = {"write-a-mechanism.md", "gallery.md"}
PAGES = sorted(page.name for page in DOCS.glob("*.md") if page.name not in ELSEWHERE)
RUN = [page for page in PAGES if any(kind in ("$", "python") for kind, _ in steps(page))]


@pytest.mark.slow
@pytest.mark.parametrize("page", RUN)
def test_commands_of_a_page_give_the_shown_output(page, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fits").symlink_to(ROOT / "fits")
    names, printed = {"__name__": page}, ""
    for kind, text in steps(page):
        if kind == "$":
            word, *rest = shlex.split(text)
            assert word == "pamjax", text
            assert main(rest) == 0, (text, capsys.readouterr().err)
            printed = capsys.readouterr().out or printed
        elif kind == "text":
            for line in text.splitlines():
                assert any(_is_similar(line, other) for other in printed.splitlines()), (line, printed)
        elif kind == "python":
            exec(compile(text, page, "exec"), names)
        else:
            (tmp_path / kind).parent.mkdir(exist_ok=True)
            (tmp_path / kind).write_text(text, "utf-8")


NUMBER = re.compile(r"(?<![a-z])\d+\.?\d*(?:e[+-]\d+)?")


def _is_similar(line, other, rel=0.05):
    """Return whether two lines have the same words, and numbers within the tolerance between machines."""
    if NUMBER.sub("#", line).split() != NUMBER.sub("#", other).split():
        return False
    pairs = zip(NUMBER.findall(line), NUMBER.findall(other), strict=True)
    return all(float(a) == pytest.approx(float(b), rel=rel, abs=0.01) for a, b in pairs)


def test_lines_are_compared_by_words_and_numbers():
    line = "  force: rmse 6.78 N, its noise 2.51 N"
    assert _is_similar(line, "force:   rmse 6.79 N, its noise 2.51 N")
    assert not _is_similar(line, "  force: rmse 7.78 N, its noise 2.51 N")
    assert not _is_similar(line, "  diameter: rmse 6.78 N, its noise 2.51 N")


def test_front_page_shows_output_of_other_pages():
    """Output without a command on the front page is part of the tutorial or a recipe, whose commands run."""
    answers = [body for page in RUN for kind, body in steps(page) if kind == "text"]
    printed = {line for body in answers for line in body.splitlines()}
    shown = re.findall(r"^```none\n(.*?)^```", (DOCS / "index.md").read_text("utf-8"), re.S | re.M)
    assert len(shown) == 2
    for body in shown:
        assert set(body.splitlines()) <= printed


def test_pages_with_commands_are_run():
    assert {"tutorial.md", "how-to.md", "index.md", "physics.md"} <= set(RUN)
    assert sum(kind == "$" for page in RUN for kind, _ in steps(page)) >= 15


@pytest.mark.slow
def test_the_site_builds_without_a_warning(tmp_path):
    words = [
        sys.executable,
        "-m",
        "sphinx",
        "-W",
        "-q",
        "-E",
        "-b",
        "html",
        str(DOCS),
        str(tmp_path / "site"),
    ]
    process = subprocess.run(words, capture_output=True, text=True, timeout=900, check=False, cwd=ROOT)
    assert process.returncode == 0, process.stderr
    pages = {path.name for path in (tmp_path / "site").rglob("*.html")}
    assert {"index.html", "mechanisms.html", "commands.html", "reference.html"} <= pages
    assert {"validation.html", "performance.html", "glossary.html"} <= pages
    for page in (tmp_path / "site").rglob("*.html"):
        assert not re.search(r"/tmp/|/home/|/root/", page.read_text("utf-8")), page.name


def test_broken_link_fails_the_build(tmp_path):
    for name in ("conf.py", "errata.md"):
        (tmp_path / name).write_bytes((DOCS / name).read_bytes())
    (tmp_path / "conf.py").write_text('extensions = ["myst_parser"]\n')
    (tmp_path / "index.md").write_text("# Home\n\n[nowhere](nowhere.md)\n")
    words = [sys.executable, "-m", "sphinx", "-W", "-q", "-b", "html", str(tmp_path), str(tmp_path / "site")]
    process = subprocess.run(words, capture_output=True, text=True, timeout=120, check=False)
    assert process.returncode != 0
