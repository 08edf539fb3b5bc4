"""Folder of compiled programs, and the warning if it cannot be used."""

import os
import stat

import jax
import pytest

import pamjax.compile.jax_cache
from pamjax.compile.jax_cache import keep_compiled
from pamjax.errors import BadInput


@pytest.fixture
def unset_cache(monkeypatch, tmp_path):
    """Reset the state to that of a new process, and compile nothing."""
    before = jax.config.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", None)
    monkeypatch.delenv("PAMJAX_CACHE_DIR")
    (tmp_path / "file").write_text("mine")
    yield tmp_path / "file"
    jax.config.update("jax_compilation_cache_dir", before)


def test_folder_that_is_set_for_jax_is_kept(tmp_path):
    assert str(keep_compiled(tmp_path)) == jax.config.jax_compilation_cache_dir != str(tmp_path)


def test_named_folder_is_created(unset_cache, monkeypatch):
    monkeypatch.setenv("PAMJAX_CACHE_DIR", str(unset_cache.parent / "new"))
    assert keep_compiled() == unset_cache.parent / "new" / "compiled"
    assert (unset_cache.parent / "new" / "compiled").is_dir()


def test_invalid_folder_is_reported(unset_cache, monkeypatch):
    monkeypatch.setenv("PAMJAX_CACHE_DIR", str(unset_cache))
    with pytest.raises(BadInput, match=r"must be writable; got .*file in PAMJAX_CACHE_DIR"):
        keep_compiled()


def test_invalid_default_folder_is_ignored(unset_cache, monkeypatch):
    monkeypatch.setattr(pamjax.compile.jax_cache, "_find_user_folder", lambda: unset_cache)
    assert keep_compiled() is None
    assert jax.config.jax_compilation_cache_dir is None


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="needs users and modes")
def test_new_folder_is_private(unset_cache, monkeypatch):
    monkeypatch.setenv("PAMJAX_CACHE_DIR", str(unset_cache.parent / "new"))
    folder = keep_compiled()
    assert folder is not None
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="needs users and modes")
def test_folder_that_others_can_write_to_is_refused(unset_cache, monkeypatch):
    (unset_cache.parent / "compiled").mkdir()
    (unset_cache.parent / "compiled").chmod(0o777)
    monkeypatch.setattr(pamjax.compile.jax_cache, "_find_user_folder", lambda: unset_cache.parent)
    assert keep_compiled() is None
    monkeypatch.setenv("PAMJAX_CACHE_DIR", str(unset_cache.parent))
    message = "only you may write to the folder for compiled programs, because pamjax runs its files; got"
    with pytest.raises(BadInput, match=f"{message} .*compiled in PAMJAX_CACHE_DIR. Choose another folder"):
        keep_compiled()


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="needs users and modes")
def test_folder_of_another_user_is_refused(unset_cache, monkeypatch):
    monkeypatch.setenv("PAMJAX_CACHE_DIR", str(unset_cache.parent))
    (unset_cache.parent / "compiled").mkdir()
    monkeypatch.setattr(os, "geteuid", lambda: 4711)
    os.chown(unset_cache.parent / "compiled", 4712, -1) if os.getuid() == 0 else pytest.skip("needs root")
    with pytest.raises(BadInput, match="only you may write to the folder"):
        keep_compiled()


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="needs users and modes")
def test_right_of_the_group_is_withdrawn_in_the_default_folder(unset_cache, monkeypatch):
    folder = unset_cache.parent / "compiled"
    folder.mkdir()
    folder.chmod(0o775)
    monkeypatch.setattr(pamjax.compile.jax_cache, "_find_user_folder", lambda: unset_cache.parent)
    assert keep_compiled() == folder
    assert stat.S_IMODE(folder.stat().st_mode) == 0o755


@pytest.mark.skipif(not hasattr(os, "geteuid"), reason="needs users and modes")
@pytest.mark.parametrize("by_argument", [True, False])
def test_named_folder_of_a_group_is_refused_and_unchanged(unset_cache, monkeypatch, by_argument):
    folder = unset_cache.parent / "compiled"
    folder.mkdir()
    folder.chmod(0o775)
    monkeypatch.setenv("PAMJAX_CACHE_DIR", str(unset_cache.parent))
    with pytest.raises(
        BadInput, match=r"only you may write .*remove others' write permission \(chmod go-w\)"
    ):
        keep_compiled(folder if by_argument else None)
    assert stat.S_IMODE(folder.stat().st_mode) == 0o775
