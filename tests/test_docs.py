"""Pages of the documentation: their code runs, their output is current, and their sentences are short."""

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
    fences = FENCE.findall((ROOT / page).read_text(encoding="utf-8"))
    return [body for word, body in fences if word == language]


@pytest.mark.slow
@pytest.mark.parametrize("page", PAGES)
def test_code_runs(page, monkeypatch):
    monkeypatch.chdir(ROOT)
    code = blocks(page, "python")
    assert code
    exec(compile("\n".join(code), page, "exec"), {"__name__": page.replace("/", ".")})


@pytest.mark.slow
def test_readme_shows_the_output_of_fit():
    (shown,) = (b for b in blocks("README.md", "") if "thread.modulus" in b)
    note = str(pamjax.fit(pamjax.read_case(ROOT / "fits/chambers_wereley_2022")))
    assert _first_numbers(note) == _first_numbers(shown)


def test_readme_shows_the_diagnosis_of_the_tutorial():
    (shown,) = blocks("README.md", "text")
    assert "braid_friction" in shown
    assert set(shown.splitlines()) <= set("".join(blocks("docs/tutorial.md", "text")).splitlines())


def section(title):
    return re.search(rf"^## {title}\n(.*?)^## ", (ROOT / "README.md").read_text("utf-8"), re.S | re.M)[1]


def first_commands():
    """Return the commands of the front page for a first recording."""
    lines = re.findall(r"^    pamjax (.*)", section("Command line"), re.M)
    return [shlex.split(line, comments=True) for line in lines]


@pytest.mark.slow
def test_first_commands_of_the_front_page_run(tmp_path, monkeypatch, capsys):
    copied = first_commands()
    assert [word for word, *_ in copied] == ["new", "check", "fit", "diagnose"]
    assert {case for _, case, *_ in copied} == {"mine"}
    monkeypatch.chdir(tmp_path)
    for words in copied[:3]:  # without compiled programs a diagnosis takes minutes
        assert main(words) == 0, capsys.readouterr().err


def test_git_ignores_what_the_first_commands_write():
    ignored = (ROOT / ".gitignore").read_text("utf-8").split()
    text = (ROOT / "README.md").read_text("utf-8") + (ROOT / "docs/tutorial.md").read_text("utf-8")
    folders = {out.split("/")[0] for out in re.findall(r"(?m)^(?:    |\$ )pamjax .*?--out (\S+)", text)}
    folders |= set(re.findall(r"(?m)^(?:    |\$ )pamjax new (\S+)", text))
    assert folders == {"mine", "out", "again"}
    assert all({f"/{name}/", f"{name}/"} & set(ignored) for name in folders)
    assert {f"/{name}" for name in re.findall(r"(?m)^:caption: (\S+)", text)} <= set(ignored)


def test_table_of_commands_is_complete():
    shown = re.findall(r"`pamjax (\S+?)`", section("Commands"))
    assert sorted(shown) == sorted(name for name in app if name[0] != "-")
    assert {word for word, *_ in first_commands()} <= set(shown)


def test_readme_has_the_test_command_that_ci_runs():
    (line,) = re.findall(r"^    (python3.11 .*pytest.*)", section("Install"), re.M)
    for word in ("-m venv", "install", "-e '.[test]'", "-m pytest -n 2"):
        assert word in line
        assert word in (ROOT / ".ci/run").read_text("utf-8")


def _first_numbers(note):
    """Return names, values and standard deviations; the last digit of an rmse depends on the machine."""
    return re.findall(r"^  (\S+\.\S+)\s+([\d.]+ ± [\d.]+)", note, re.M)


def test_contributors_page_is_short():
    assert len((ROOT / "docs/write-a-mechanism.md").read_text(encoding="utf-8").splitlines()) < 60


def test_every_entry_of_a_file_is_documented():
    from pydantic import BaseModel

    from pamjax.planning import rig_capabilities
    from pamjax.records.protocol import Protocol
    from pamjax.sizing.specification import schema

    page = (ROOT / "docs/files.md").read_text("utf-8")
    tables = [t for t in vars(schema).values() if isinstance(t, type) and issubclass(t, BaseModel)]
    words = {name for table in (*tables, Protocol) for name in table.model_fields}
    words |= {*rig_capabilities.ERROR_ENTRIES, *rig_capabilities.ENTRY_KINDS}
    assert len(words) > 50
    in_tables = {
        f"[{name}]" for name, field in schema.SpecEntries.model_fields.items() if f"[{name}]" in page
    }
    missing = {word for word in words if f"`{word}`" not in page and f"[{word}]" not in in_tables}
    assert not missing


def test_table_of_import_entries_is_complete():
    from pamjax.records.importing.import_spec import (
        LENGTH_SOURCES,
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
    words = {*COLUMN_KINDS, *LENGTH_SOURCES, *ChannelEntry.model_fields, *tables, "[columns]"}
    words |= {name for table in tables.values() for name in table.model_fields}
    words |= set(ImportSpec.model_fields) - {"files", "columns", "tare", "tests"}
    assert shown == words


FRONT = ["README.md", "CONTRIBUTING.md", "CHANGELOG.md"]
READ = [
    *FRONT,
    *sorted(
        path.relative_to(ROOT).as_posix()
        for path in (*ROOT.glob("docs/*.md"), *ROOT.glob("fits/*/README.md"))
    ),
]
#: Largest number of lines of the page of a fit.
FIT_PAGE_LINES = 80
NOTEBOOKS = sorted(path.relative_to(ROOT).as_posix() for path in ROOT.glob("notebooks/*.ipynb"))
#: Largest number of words of a sentence.
WORDS = 25
#: Text other than prose: blocks of code, comments, equations, tables, indented code, quotations and headings.
NO_PROSE = re.compile(
    r"```.*?```|<!--.*?-->|\$\$.*?\$\$|\|[^\n]*$|^ {4}[^\n]*$|^>[^\n]*$|^#+ [^\n]*$", re.S | re.M
)
#: A sentence ends at its punctuation mark, or with its list item or paragraph.
END = re.compile(r"(?<=[.!?])[)*_\"]*\s+|\n\s*\n|\n\s*(?=[-*] |\d+\. )|\n(?=: )")


@pytest.mark.parametrize("name", [name for name in READ if name.startswith("fits/")])
def test_page_of_a_fit_is_short(name):
    assert len((ROOT / name).read_text("utf-8").splitlines()) <= FIT_PAGE_LINES


def too_long(text):
    """Return the sentences of a page above `WORDS` words; code within a line counts as one."""
    prose = re.sub(r"`[^`]*`", "x", NO_PROSE.sub("\n\n", text))
    return [sentence for sentence in END.split(prose) if len(sentence.split()) > WORDS]


@pytest.mark.parametrize("page", READ)
def test_sentences_of_pages_are_short(page):
    assert not too_long((ROOT / page).read_text(encoding="utf-8"))


@pytest.mark.parametrize("page", NOTEBOOKS)
def test_sentences_of_notebooks_are_short(page):
    cells = json.loads((ROOT / page).read_text("utf-8"))["cells"]
    text = "\n\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "markdown")
    assert not too_long(text)


def list_scripts(text):
    """Return the files of the scripts and modules in the commands of a page."""
    modules = re.findall(r"python -m (tests(?:\.\w+)+)", text)
    return [
        *re.findall(r"python ((?:fits|tests)/\S+\.py)", text),
        *(m.replace(".", "/") + ".py" for m in modules),
    ]


def test_scripts_in_the_commands_of_pages_exist():
    scripts = {script for page in READ for script in list_scripts((ROOT / page).read_text("utf-8"))}
    assert len(scripts) > 15
    assert {script for script in scripts if not (ROOT / script).is_file()} == set()


def test_scripts_of_commands_are_detected():
    text = "`python -m tests.a.b 3`, python -m tests.c.\n\n    python fits/d.py X"
    assert list_scripts(text) == ["fits/d.py", "tests/a/b.py", "tests/c.py"]


def test_long_sentences_are_detected_in_prose_only():
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
    """Return the texts that look like a commit hash: hexadecimal numbers of at least seven digits."""
    return re.findall(r"\b(?=\w*\d)(?=\w*[a-f])[0-9a-f]{7,40}\b", text)


def test_commit_hashes_are_detected():
    assert hashes("at `c1ad8a2`, of 20261123 recordings, facade, 1234567") == ["c1ad8a2"]


def list_stored_numbers():
    """Yield (page, figures of a row, stored file) of each table row that links to stored figures."""
    for page in sorted(ROOT.glob("docs/*.md")):
        for row in re.findall(r"^\|(.*)\|$", page.read_text("utf-8"), re.M):
            _, *cells = row.split("|")
            for name in re.findall(r"\]\((benchmarks/\S+\.json)\)", cells[-1] if cells else ""):
                yield page.name, " ".join(cells[:-1]), ROOT / "docs" / name


def is_kept(text, values):
    """Return whether a figure is one of the stored values, rounded as on the page."""
    number, half = float(text.replace(",", "")), 0.5 * 10.0 ** -len(text.partition(".")[2])
    return any(abs(value - number) <= half * (1 + 1e-6) for value in values)


def test_figures_of_pages_agree_with_the_stored_files():
    rows = list(list_stored_numbers())
    assert {file for _, _, file in rows} == set(ROOT.glob("docs/benchmarks/*.json"))
    for page, shown, file in rows:
        kept = json.loads(file.read_text("utf-8"))["figures"].values()
        values = [entry for value in kept for entry in (value if isinstance(value, list) else [value])]
        numbers = re.findall(r"\d[\d,]*\.?\d*", shown)
        assert numbers, (page, file.name)
        for number in numbers:
            assert is_kept(number, values), (page, file.name, number)


def test_figures_that_are_not_stored_are_detected():
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
