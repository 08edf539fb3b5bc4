"""Folder of compiled programs, and the warning if it cannot be used."""

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
