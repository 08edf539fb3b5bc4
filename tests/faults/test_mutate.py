"""Mutated inputs are accepted or refused in one sentence; the test detects a reader that does neither."""

import sys
import time
import warnings

import numpy as np
import pytest

import tests.faults.mutate as under_test
from pamjax.errors import BadInput, InputWarning
from tests.faults.edits import mutate_csv, mutate_toml
from tests.faults.inputs import KINDS, InputKind, replace_file, write_mutation
from tests.faults.mutate import find_fault, run_mutations

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="needs POSIX signals")


@pytest.mark.parametrize("name", KINDS)
def test_mutated_input_is_accepted_or_refused_in_one_sentence(name):
    tally = run_mutations(KINDS[name], count=40, seed=11)
    assert tally.failures == []
    assert tally.accepted + tally.refused == 40
    # A mutation that is always refused reaches only the first check of the reader.
    assert tally.accepted > 0
    assert tally.refused > 10


def count_failures(read, monkeypatch):
    """Return what is wrong with a reader of the kind `rig`, by the words of its failures."""
    build = KINDS["rig"].build_examples
    monkeypatch.setattr(under_test, "read_examples", lambda kind: None)
    return [problem for _, problem in run_mutations(InputKind("rig", build, read), 2, seed=0).failures]


def raise_error(error):
    def read(folder):
        raise error

    return read


def test_reader_with_another_error_is_detected(monkeypatch):
    for error, words in (
        (KeyError("x"), "KeyError"),
        (BadInput("two\nlines."), "not one line"),
        (BadInput("no sentence"), "no sentence"),
        (BadInput("long " * 400 + "."), "characters"),
        (OSError(5, "broken"), "OSError"),
    ):
        problems = count_failures(raise_error(error), monkeypatch)
        assert len(problems) == 2
        assert all(words in problem for problem in problems)
    assert count_failures(raise_error(BadInput("`x` must be positive; got -1.")), monkeypatch) == []
    assert count_failures(raise_error(OSError(36, "File name too long")), monkeypatch) == []


def test_warnings_for_the_user_are_no_failures(monkeypatch):
    def warn(kind):
        return lambda folder: warnings.warn("text", kind, stacklevel=1)

    assert len(count_failures(warn(RuntimeWarning), monkeypatch)) == 2
    assert count_failures(warn(InputWarning), monkeypatch) == []


def test_reader_without_an_end_is_detected(monkeypatch):
    monkeypatch.setattr(under_test, "LONGEST_WAIT", 0.2)
    assert count_failures(lambda folder: time.sleep(60), monkeypatch) == ["no end after 0.2 s"] * 2


def test_reader_that_needs_much_time_or_memory_is_detected(monkeypatch):
    monkeypatch.setattr(under_test, "LONGEST_TIME", 0.05)

    def compute(folder):
        while time.process_time() < end:
            pass

    end = time.process_time() + 0.2
    assert "s of processor time" in count_failures(compute, monkeypatch)[0]
    monkeypatch.setattr(under_test, "LONGEST_TIME", 5.0)
    monkeypatch.setattr(under_test, "LARGEST_MEMORY", 20_000_000)
    assert "MB" in count_failures(lambda folder: np.ones(10_000_000).sum(), monkeypatch)[0]


def test_fault_of_a_message_is_stated():
    assert find_fault("`x` must be positive; got -1 in a.toml. Did you mean `y`?") == ""
    assert find_fault("a\x1b[31m.") != ""


def test_same_number_gives_the_same_mutation(tmp_path):
    for name in ("first", "second"):
        (tmp_path / name).mkdir()
        write_mutation(KINDS["muscle.toml"], tmp_path / name, np.random.default_rng([3, 5]))
    assert (tmp_path / "first/muscle.toml").read_bytes() == (tmp_path / "second/muscle.toml").read_bytes()


def test_edits_change_most_texts():
    (example, *_) = KINDS["case folder"].build_examples()
    for mutate, name in ((mutate_toml, "muscle.toml"), (mutate_csv, "recording.csv")):
        text = example[name]
        results = [mutate(text, np.random.default_rng(k)) for k in range(60)]
        assert len(set(results)) > 50
        assert sum(result == text.encode() for result in results) < 6


@pytest.mark.parametrize("kind", range(7))
def test_file_is_replaced(kind, tmp_path):
    file = tmp_path / "muscle.toml"
    file.write_text("x")
    replace_file(file, kind)
    assert not (file.is_file() and file.read_text() == "x")
