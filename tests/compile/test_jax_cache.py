"""Where compiled programs are kept, and what is said where they cannot be."""

import jax
import pytest

import pamjax.compile.jax_cache
from pamjax.compile.jax_cache import keep_compiled
from pamjax.errors import BadInput


@pytest.fixture
def fresh(monkeypatch, tmp_path):
    """As in a process that has named no folder yet; nothing is compiled meanwhile."""
    before = jax.config.jax_compilation_cache_dir
    jax.config.update("jax_compilation_cache_dir", None)
    monkeypatch.delenv("PAMJAX_CACHE_DIR")
    (tmp_path / "file").write_text("mine")
    yield tmp_path / "file"
    jax.config.update("jax_compilation_cache_dir", before)


def test_a_folder_that_was_set_for_jax_stays(tmp_path):
    assert str(keep_compiled(tmp_path)) == jax.config.jax_compilation_cache_dir != str(tmp_path)


def test_a_named_folder_is_made(fresh, monkeypatch):
    monkeypatch.setenv("PAMJAX_CACHE_DIR", str(fresh.parent / "new"))
    assert keep_compiled() == fresh.parent / "new" / "compiled"
    assert (fresh.parent / "new" / "compiled").is_dir()


def test_a_named_folder_that_cannot_be_is_told(fresh, monkeypatch):
    monkeypatch.setenv("PAMJAX_CACHE_DIR", str(fresh))
    with pytest.raises(BadInput, match=r"need a folder to write to; got .*file in PAMJAX_CACHE_DIR"):
        keep_compiled()


def test_where_nobody_named_one_it_goes_without(fresh, monkeypatch):
    monkeypatch.setattr(pamjax.compile.jax_cache, "_find_user_folder", lambda: fresh)
    assert keep_compiled() is None
    assert jax.config.jax_compilation_cache_dir is None
