"""Files are written completely or not at all, also if interrupted."""

import os
import signal

import pytest

from pamjax.errors import BadInput
from pamjax.records.files import read_bytes, write_atomically, write_folder_atomically, write_results_together


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_file_is_replaced(tmp_path):
    with write_atomically(tmp_path / "fit.json") as temporary:
        assert temporary.parent == tmp_path
        assert temporary.suffix == ".json"
        temporary.write_text("{}")
    assert names(tmp_path) == ["fit.json"]
    assert (tmp_path / "fit.json").read_text() == "{}"


@pytest.mark.parametrize("stop", [KeyboardInterrupt, ValueError])
def test_interrupted_write_keeps_the_old_file(tmp_path, stop):
    (tmp_path / "fit.json").write_text("old")
    with pytest.raises(stop), write_atomically(tmp_path / "fit.json") as temporary:  # noqa: PT012
        temporary.write_text("ha")
        raise stop
    assert names(tmp_path) == ["fit.json"]
    assert (tmp_path / "fit.json").read_text() == "old"


def test_missing_folder_is_refused(tmp_path):
    path = tmp_path / "nowhere" / "fit.json"
    with pytest.raises(BadInput) as error, write_atomically(path):
        pass
    assert str(error.value) == f"the folder of {path} must exist. Create it, or check the path."


def test_several_files_are_replaced_together(tmp_path):
    folder = tmp_path / "out"
    for text in ("one", "two"):
        with write_folder_atomically(folder) as temporary:
            (temporary / "a.txt").write_text(text)
            (temporary / "plots").mkdir()
            (temporary / "plots" / "b.txt").write_text(text)
            assert not folder.exists() or (folder / "a.txt").read_text() == "one"
        assert (folder / "plots" / "b.txt").read_text() == text
    assert names(tmp_path) == ["out"]
    assert names(folder) == ["a.txt", "plots"]


def test_other_files_of_the_folder_are_kept(tmp_path):
    (tmp_path / "notes.md").write_text("mine")
    with write_folder_atomically(tmp_path) as temporary:
        (temporary / "a.txt").write_text("a")
    assert names(tmp_path) == ["a.txt", "notes.md"]


@pytest.mark.parametrize("exists", [True, False])
def test_interrupted_write_leaves_the_folder_unchanged(tmp_path, exists):
    folder = tmp_path / "out"
    if exists:
        folder.mkdir()
        (folder / "a.txt").write_text("old")
    with pytest.raises(KeyboardInterrupt), write_folder_atomically(folder) as temporary:  # noqa: PT012
        (temporary / "a.txt").write_text("new")
        raise KeyboardInterrupt
    assert names(tmp_path) == (["out"] if exists else [])
    assert not exists or (folder / "a.txt").read_text() == "old"


@pytest.mark.parametrize(
    "numbers", [(signal.SIGINT,), (signal.SIGTERM,), (signal.SIGINT, signal.SIGTERM)], ids=str
)
def test_signal_during_the_renames_is_delayed(tmp_path, monkeypatch, interruptible, numbers):
    from pamjax.cli.screen import defer_interrupts, is_terminated
    from pamjax.records import files

    move_files = files._move_files

    def interrupted(source, target):
        for number in numbers:
            signal.raise_signal(number)
        move_files(source, target)

    monkeypatch.setattr(files, "_move_files", interrupted)
    with pytest.raises(KeyboardInterrupt), defer_interrupts():  # noqa: PT012, SIM117
        with write_folder_atomically(tmp_path / "out") as temporary:
            (temporary / "a.txt").write_text("a")
            (temporary / "b.txt").write_text("b")
    assert names(tmp_path / "out") == ["a.txt", "b.txt"]
    assert names(tmp_path) == ["out"]
    assert is_terminated() == (signal.SIGTERM in numbers)
    assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL


def test_results_are_written_together_or_not_at_all(tmp_path):
    out = tmp_path / "a" / "out"
    with pytest.raises(OSError, match="full"), write_results_together(out) as folder:  # noqa: PT012
        (folder / "fit.json").write_text("new")
        raise OSError("the disk is full")
    assert not out.exists()
    out.mkdir(parents=True)
    for name in ("fit.json", "report.html", "notes.txt"):
        (out / name).write_text("old")
    with pytest.raises(OSError, match="full"), write_results_together(out) as folder:  # noqa: PT012
        (folder / "fit.json").write_text("new")
        raise OSError("the disk is full")
    # The old report stays beside the old result.
    assert {path.name: path.read_text() for path in out.iterdir()} == dict.fromkeys(
        ("fit.json", "report.html", "notes.txt"), "old"
    )
    with write_results_together(out) as folder:
        (folder / "fit.json").write_text("new")
        (folder / "report.html").write_text("new")
        assert (out / "fit.json").read_text() == "old"
    assert {path.name: path.read_text() for path in out.iterdir()} == {
        "fit.json": "new", "report.html": "new", "notes.txt": "old",
    }  # fmt: skip


def test_files_of_an_earlier_result_are_removed_with_the_move(tmp_path):
    for name in ("fit.json", "prior.png", "notes.txt"):
        (tmp_path / name).write_text("old")
    earlier_names = ["fit.json", "prior.png", "gone.png"]
    with pytest.raises(OSError, match="full"), write_results_together(tmp_path, earlier_names):
        raise OSError("the disk is full")
    assert names(tmp_path) == ["fit.json", "notes.txt", "prior.png"]
    with write_results_together(tmp_path, earlier_names) as folder:
        (folder / "fit.json").write_text("new")
        assert (tmp_path / "prior.png").exists()
    assert names(tmp_path) == ["fit.json", "notes.txt"]
    assert (tmp_path / "fit.json").read_text() == "new"


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no pipes with a name")
@pytest.mark.parametrize("kind", ["pipe", "device"])
def test_file_without_an_end_is_refused(kind, tmp_path):
    file = tmp_path / "recording.csv"
    os.mkfifo(file) if kind == "pipe" else file.symlink_to("/dev/zero")
    with pytest.raises(BadInput, match=r"recording\.csv must be a file; got a pipe or a device\. Write its"):
        read_bytes(file)
