"""Nothing is written half, whatever interrupts."""

import signal

import pytest

from pamjax.errors import BadInput
from pamjax.records.files import write_atomically, write_folder_atomically


def names(folder):
    return sorted(path.name for path in folder.iterdir())


def test_a_file_takes_its_place(tmp_path):
    with write_atomically(tmp_path / "fit.json") as temporary:
        assert temporary.parent == tmp_path
        assert temporary.suffix == ".json"
        temporary.write_text("{}")
    assert names(tmp_path) == ["fit.json"]
    assert (tmp_path / "fit.json").read_text() == "{}"


@pytest.mark.parametrize("stop", [KeyboardInterrupt, ValueError])
def test_an_interrupted_file_leaves_the_old_one(tmp_path, stop):
    (tmp_path / "fit.json").write_text("old")
    with pytest.raises(stop), write_atomically(tmp_path / "fit.json") as temporary:  # noqa: PT012
        temporary.write_text("ha")
        raise stop
    assert names(tmp_path) == ["fit.json"]
    assert (tmp_path / "fit.json").read_text() == "old"


def test_a_folder_must_exist(tmp_path):
    path = tmp_path / "nowhere" / "fit.json"
    with pytest.raises(BadInput) as told, write_atomically(path):
        pass
    assert str(told.value) == f"the folder of {path} must exist. Make it first, or check its name."


def test_several_files_take_their_places_together(tmp_path):
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


def test_other_files_of_the_folder_stay(tmp_path):
    (tmp_path / "notes.md").write_text("mine")
    with write_folder_atomically(tmp_path) as temporary:
        (temporary / "a.txt").write_text("a")
    assert names(tmp_path) == ["a.txt", "notes.md"]


@pytest.mark.parametrize("exists", [True, False])
def test_an_interrupted_folder_is_untouched(tmp_path, exists):
    folder = tmp_path / "out"
    if exists:
        folder.mkdir()
        (folder / "a.txt").write_text("old")
    with pytest.raises(KeyboardInterrupt), write_folder_atomically(folder) as temporary:  # noqa: PT012
        (temporary / "a.txt").write_text("new")
        raise KeyboardInterrupt
    assert names(tmp_path) == (["out"] if exists else [])
    assert not exists or (folder / "a.txt").read_text() == "old"


def test_ctrl_c_amid_the_renames_waits_for_them(tmp_path, monkeypatch, interruptible):
    from pamjax.records import files

    moved = files._move_files

    def interrupted(source, target):
        signal.raise_signal(signal.SIGINT)
        moved(source, target)

    monkeypatch.setattr(files, "_move_files", interrupted)
    with pytest.raises(KeyboardInterrupt), write_folder_atomically(tmp_path / "out") as temporary:  # noqa: PT012
        (temporary / "a.txt").write_text("a")
        (temporary / "b.txt").write_text("b")
    assert names(tmp_path / "out") == ["a.txt", "b.txt"]
    assert names(tmp_path) == ["out"]
