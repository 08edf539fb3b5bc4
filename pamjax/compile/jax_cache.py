"""JAX's persistent cache of compiled programs."""

from __future__ import annotations

import os
import stat
import warnings
from pathlib import Path

import jax

from pamjax.errors import BadInput


def keep_compiled(folder: str | Path | None = None) -> Path | None:
    """Turn on JAX's persistent compilation cache, and return its folder.

    A folder that is already configured in JAX has precedence.

    Args:
        folder: folder for compiled programs; None for `compiled` in `PAMJAX_CACHE_DIR`, or in the user's
            cache folder.

    Returns:
        the folder; None if no folder was given and the user's cache folder is not writable, or not private.
        Then every process compiles its own programs.

    Raises:
        BadInput: if a given folder is not writable, or if other users can write to it.

    Example:
        pamjax.keep_compiled()  # later processes do not compile again
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
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        if not os.access(folder, os.W_OK):
            raise PermissionError(folder)
        is_private = _is_private(folder) or (not chosen_folder and _withdraw_group(folder))
    except OSError as error:
        if not chosen_folder:
            return None
        rule = "the folder for compiled programs must be writable"
        raise BadInput.from_rule(rule, f"{chosen_folder}", place, "Choose another folder.") from error
    if not is_private:
        if not chosen_folder:
            return None
        rule = "only you may write to the folder for compiled programs, because pamjax runs its files"
        remedy = "Choose another folder, delete this one, or remove others' write permission (chmod go-w)."
        raise BadInput.from_rule(rule, f"{folder}", place, remedy)
    # JAX issues one warning for each program if the disk is full or the folder disappears.
    warnings.filterwarnings("ignore", "Error (reading|writing) persistent compilation cache")
    jax.config.update("jax_compilation_cache_dir", str(folder))
    # Also cache small programs: all small programs of a fit together compile longer than its largest one.
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
    return folder


def _is_private(folder: Path) -> bool:
    """Return whether only this user, or the administrator, can write to a folder.

    Without users, as on Windows, every folder is accepted.
    """
    if not hasattr(os, "geteuid"):
        return True
    status = folder.stat()
    return status.st_uid in (0, os.geteuid()) and not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _withdraw_group(folder: Path) -> bool:
    """Withdraw the group's right to write to pamjax's own folder; return whether it is then private.

    Some systems give new folders this right by default. A folder that the user named keeps its mode.
    """
    status = folder.stat()
    if status.st_uid == os.geteuid():
        folder.chmod(stat.S_IMODE(status.st_mode) & ~stat.S_IWGRP)
    return _is_private(folder)


def _find_user_folder() -> Path:
    from platformdirs import user_cache_path

    return user_cache_path("pamjax", appauthor=False)
