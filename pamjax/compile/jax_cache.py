"""JAX's persistent cache of compiled programs."""

from __future__ import annotations

import os
from pathlib import Path

import jax

from pamjax.errors import refuse


def keep_compiled(folder: str | Path | None = None) -> Path | None:
    """Turn on JAX's persistent compilation cache, and return its folder.

    A folder that is already configured in JAX has precedence.

    Args:
        folder: folder for compiled programs; None for `compiled` in `PAMJAX_CACHE_DIR`, or in the user's
            cache folder.

    Returns:
        the folder; None if no folder was given and the user's cache folder is not writable. Then every
        process compiles its own programs.

    Raises:
        BadInput: if a given folder is not writable.
    """
    configured_folder = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    if configured_folder:
        return Path(configured_folder)
    chosen_folder, place = folder, ""
    if folder is None:
        chosen_folder, place = os.environ.get("PAMJAX_CACHE_DIR"), "PAMJAX_CACHE_DIR"
        folder = Path(chosen_folder or _find_user_folder()) / "compiled"
    folder = Path(folder)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not os.access(folder, os.W_OK):
            raise PermissionError(folder)
    except OSError as error:
        if not chosen_folder:
            return None
        rule = "the folder for compiled programs must be writable"
        raise refuse(rule, f"{chosen_folder}", place, "Choose another folder.") from error
    jax.config.update("jax_compilation_cache_dir", str(folder))
    # Also cache small programs: all small programs of a fit together compile longer than its largest one.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    return folder


def _find_user_folder() -> Path:
    from platformdirs import user_cache_path

    return user_cache_path("pamjax", appauthor=False)
