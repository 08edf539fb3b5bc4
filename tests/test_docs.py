"""What the pages show is what happens, and every page can be read once and understood."""

import json
import re
import shlex
from pathlib import Path

import pytest

import pamjax
from pamjax.cli.main import app, main

ROOT = Path(__file__).parents[1]
PAGES = ["README.md", "docs/write-a-mechanism.md"]
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.S | re.M)


def blocks(page, language):
    found = FENCE.findall((ROOT / page).read_text(encoding="utf-8"))
    return [body for word, body in found if word == language]


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
    (shown,) = blocks("README.md", "text")
    assert "braid_friction" in shown
    assert set(shown.splitlines()) <= set("".join(blocks("docs/tutorial.md", "text")).splitlines())


def section(title):
    return re.search(rf"^## {title}\n(.*?)^## ", (ROOT / "README.md").read_text("utf-8"), re.S | re.M)[1]


def first_commands():
    """The commands of the front page for one's own recording, to copy from top to bottom."""
    lines = re.findall(r"^    pamjax (.*)", section("Command line"), re.M)
    return [shlex.split(line, comments=True) for line in lines]


@pytest.mark.slow
def test_the_first_commands_of_the_front_page_follow_one_another(tmp_path, monkeypatch, capsys):
    copied = first_commands()
    assert [word for word, *_ in copied] == ["new", "check", "fit", "diagnose"]
    assert {case for _, case, *_ in copied} == {"mine"}
    monkeypatch.chdir(tmp_path)
    for words in copied[:3]:  # a diagnosis takes minutes where nothing is compiled
        assert main(words) == 0, capsys.readouterr().err


def test_the_table_of_commands_has_every_command_and_no_other():
    shown = re.findall(r"`pamjax (\S+?)`", section("Commands"))
    assert sorted(shown) == sorted(name for name in app if name[0] != "-")
    assert {word for word, *_ in first_commands()} <= set(shown)


def test_readme_has_the_test_command_that_ci_runs():
    (line,) = re.findall(r"^    (python3.11 .*pytest.*)", section("Install"), re.M)
    for word in ("-m venv", "install", "-e '.[test]'", "-m pytest -n 2"):
        assert word in line
        assert word in (ROOT / ".ci/run").read_text("utf-8")


def _first_numbers(note):
    """Names with value and sd; the last digit of an rmse may differ between machines."""
    return re.findall(r"^  (\S+\.\S+)\s+([\d.]+ ± [\d.]+)", note, re.M)


def test_contributors_page_is_short():
    assert len((ROOT / "docs/write-a-mechanism.md").read_text(encoding="utf-8").splitlines()) < 60


def test_every_word_of_a_file_is_on_its_page():
    from pydantic import BaseModel

    from pamjax.planning import bench as means
    from pamjax.records.protocol import Protocol
    from pamjax.sizing import schema

    page = (ROOT / "docs/files.md").read_text("utf-8")
    tables = [t for t in vars(schema).values() if isinstance(t, type) and issubclass(t, BaseModel)]
    words = {name for table in (*tables, Protocol) for name in table.model_fields}
    words |= {*means.ERROR_ENTRIES, *means.ENTRY_KINDS}
    assert len(words) > 50
    in_tables = {
        f"[{name}]" for name, field in schema.SpecEntries.model_fields.items() if f"[{name}]" in page
    }
    missing = {word for word in words if f"`{word}`" not in page and f"[{word}]" not in in_tables}
    assert not missing


def test_every_word_of_an_import_is_in_its_table_and_no_other():
    from pamjax.records.importing.import_spec import (
        ChannelEntry,
        FilesTable,
        ImportSpec,
        TareTable,
        TestTable,
    )
    from pamjax.records.reading.header import COLUMN_KINDS

    page = (ROOT / "docs/files.md").read_text("utf-8")
    section = re.search(r"^## An import\n(.*?)^## ", page, re.S | re.M)[1]
    shown = {
        entry for cell in re.findall(r"^\| (.*?) \|", section, re.M) for entry in re.findall("`(.*?)`", cell)
    }
    tables = {"[files]": FilesTable, "[tare]": TareTable, "[[tests]]": TestTable}
    words = {*COLUMN_KINDS, *ChannelEntry.model_fields, *tables, "[columns]"}
    words |= {name for table in tables.values() for name in table.model_fields}
    words |= set(ImportSpec.model_fields) - {"files", "columns", "tare", "tests"}
    assert shown == words


FRONT = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md"]
READ = [*FRONT, *sorted(f"docs/{path.name}" for path in ROOT.glob("docs/*.md"))]
#: Most words of a sentence. The rule is 25; some sentences with a name or a reference need more.
WORDS = 30
#: What is no prose: blocks of code, comments, equations, tables, indented code, quotations and headings.
NO_PROSE = re.compile(
    r"```.*?```|<!--.*?-->|\$\$.*?\$\$|\|[^\n]*$|^ {4}[^\n]*$|^>[^\n]*$|^#+ [^\n]*$", re.S | re.M
)
#: A sentence ends with its mark, an item of a list or a paragraph.
END = re.compile(r"(?<=[.!?])[)*_\"]*\s+|\n\s*\n|\n\s*(?=[-*] |\d+\. )|\n(?=: )")


def too_long(text):
    """Return the sentences of a page above `ERROR_ENTRIES` words; code within a line counts as one."""
    prose = re.sub(r"`[^`]*`", "x", NO_PROSE.sub("\n\n", text))
    return [sentence for sentence in END.split(prose) if len(sentence.split()) > WORDS]


@pytest.mark.parametrize("page", READ)
def test_no_sentence_of_a_page_is_long(page):
    assert not too_long((ROOT / page).read_text(encoding="utf-8"))


def test_a_long_sentence_is_detected_and_a_table_is_none():
    long = "word " * WORDS + "word."
    assert len(too_long(f"Short. {long} Short.\n\n- {long}\n- short\n\n    {long}\n\n{long}")) == 3
    assert not too_long(f"| {long} |\n\n```\n{long}\n```\n\n    {long}\n\n> {long}\n")
    assert not too_long("one two three\n- " + "\n- ".join(["one two three"] * WORDS))


def test_readme_is_short_and_has_no_history():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 110
    assert not hashes(text)
    assert not re.search(r"\bseed\b|\bcommit\b", text, re.I)


def hashes(text):
    """Return what looks like a commit: a hexadecimal number of seven places or more."""
    return re.findall(r"\b(?=\w*\d)(?=\w*[a-f])[0-9a-f]{7,40}\b", text)


def test_a_hash_is_detected_and_a_word_or_a_number_is_none():
    assert hashes("at `c1ad8a2`, of 20261123 recordings, facade, 1234567") == ["c1ad8a2"]


def quoted():
    """(page, figures of a row as text, kept file) of each row of a table that links to kept figures."""
    for page in sorted(ROOT.glob("docs/*.md")):
        for row in re.findall(r"^\|(.*)\|$", page.read_text("utf-8"), re.M):
            _, *cells = row.split("|")
            for name in re.findall(r"\]\((benchmarks/\S+\.json)\)", cells[-1] if cells else ""):
                yield page.name, " ".join(cells[:-1]), ROOT / "docs" / name


def is_kept(text, values):
    """Is a figure one of the kept values, rounded as the page rounds?"""
    number, half = float(text.replace(",", "")), 0.5 * 10.0 ** -len(text.partition(".")[2])
    return any(abs(value - number) <= half * (1 + 1e-6) for value in values)


def test_figures_of_a_page_are_those_of_the_kept_output():
    rows = list(quoted())
    assert {file for _, _, file in rows} == set(ROOT.glob("docs/benchmarks/*.json"))
    for page, shown, file in rows:
        kept = json.loads(file.read_text("utf-8"))["figures"].values()
        values = [one for value in kept for one in (value if isinstance(value, list) else [value])]
        numbers = re.findall(r"\d[\d,]*\.?\d*", shown)
        assert numbers, (page, file.name)
        for number in numbers:
            assert is_kept(number, values), (page, file.name, number)


def test_a_figure_that_was_not_kept_is_detected():
    assert is_kept("43.2", [2.5, 43.21])
    assert is_kept("1,234", [1234.4])
    assert not is_kept("43.3", [2.5, 43.21])


def test_terms_of_the_pages_are_in_the_glossary():
    page = (ROOT / "docs/glossary.md").read_text("utf-8")
    terms = (
        "Baseline model", "Mechanism", "Held-out block", "Isobar", "False alarm", "Whitening",
        "Integrated autocorrelation time", "Score test", "Identifiability", "Errors in variables",
        "Unexplained", "Indistinguishable", "Form error", "Presliding",
    )  # fmt: skip
    for term in terms:
        assert re.search(rf"^- \*\*{term}\b", page, re.M), term
    defined = re.findall(r"^- \*\*(.+?)\*\*: ", page, re.M)
    assert len(defined) == len(set(defined)) > 50
