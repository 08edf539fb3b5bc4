"""Is what the pages show what happens? Every block of code on them runs."""

import re
import shlex
from pathlib import Path

import pytest

import pamjax
from pamjax.cli.main import app, main

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


def own_recording():
    """The front page's commands for one's own recording: to copy from top to bottom, and the others."""
    section = re.search(
        r"^## Your own recording\n(.*?)^## ", (ROOT / "README.md").read_text("utf-8"), re.S | re.M
    )[1]
    copied = [shlex.split(line, comments=True) for line in re.findall(r"^    pamjax (.*)", section, re.M)]
    return copied, [shlex.split(said) for said in re.findall(r"`pamjax (.*?)`", section)]


@pytest.mark.slow
def test_the_first_commands_of_the_front_page_follow_one_another(tmp_path, monkeypatch, capsys):
    copied, _ = own_recording()
    assert [word for word, *_ in copied] == ["new", "check", "fit", "diagnose"]
    assert {case for _, case, *_ in copied} == {"mine"}
    monkeypatch.chdir(tmp_path)
    for words in copied[:3]:  # a diagnosis takes minutes where nothing is compiled
        assert main(words) == 0, capsys.readouterr().err


def test_each_command_of_the_front_page_is_one():
    copied, others = own_recording()
    assert {word for word, *_ in (*copied, *others)} == {name for name in app if name[0] != "-"} - {"prove"}


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
    words |= {*means.WORDS, *means.KINDS}
    assert len(words) > 50
    in_tables = {f"[{name}]" for name, field in schema.Words.model_fields.items() if f"[{name}]" in page}
    missing = {word for word in words if f"`{word}`" not in page and f"[{word}]" not in in_tables}
    assert not missing


def test_every_word_of_an_import_is_in_its_table_and_no_other():
    from pamjax.records.importing.import_spec import Channel, Files, Rig, Tare, Test
    from pamjax.records.reading.header import KINDS

    page = (ROOT / "docs/files.md").read_text("utf-8")
    section = re.search(r"^## An import\n(.*?)^## ", page, re.S | re.M)[1]
    shown = {
        entry for cell in re.findall(r"^\| (.*?) \|", section, re.M) for entry in re.findall("`(.*?)`", cell)
    }
    tables = {"[files]": Files, "[tare]": Tare, "[[tests]]": Test}
    words = {*KINDS, *Channel.model_fields, *tables, "[columns]"}
    words |= {name for table in tables.values() for name in table.model_fields}
    words |= set(Rig.model_fields) - {"files", "columns", "tare", "tests"}
    assert shown == words
