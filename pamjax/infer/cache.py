"""Compiled programs are kept on disk, so that a repeated command does not compile again."""

from __future__ import annotations

import os
from pathlib import Path

import jax


def keep_compiled(folder: Path | None = None) -> Path:
    """Turn on JAX's persistent compilation cache; a folder already configured in JAX stays.

    Args:
        folder: where to keep compiled programs; None for `compiled` in `PAMJAX_CACHE_DIR`, or in the user's
            cache folder.

    Returns:
        the folder in use.
    """
    configured = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    if configured:
        return Path(configured)
    if folder is None:
        folder = Path(os.environ.get("PAMJAX_CACHE_DIR") or _user_folder()) / "compiled"
    jax.config.update("jax_compilation_cache_dir", str(folder))
    # The many small programs of a fit take longer together than the one large one.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    return folder


def _user_folder() -> Path:
    from platformdirs import user_cache_path

    return user_cache_path("pamjax", appauthor=False)
