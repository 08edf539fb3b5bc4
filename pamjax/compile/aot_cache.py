"""Traced programs, kept on disk beside the compiled ones: to trace takes longer than to read them.

JAX finds a compiled program by what was traced, so every process traces anew, for some twenty seconds. Here
the traced program is kept (StableHLO) under a name made of what it depends on: the function, its arguments
but for their values, the sources of pamjax, and the versions of what traces. It is written once the program
is compiled; processes that want it meanwhile wait, rather than compile it as well. Where the folder is in
trouble, a process goes without.

Nothing is kept where the sources are no longer those that were imported, where a mechanism of the library is
not pamjax's own, or for other devices than the processor. What a debugger patches while it runs is not seen.
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
from filelock import FileLock
from jax.stages import Compiled, Wrapped

import pamjax
from pamjax.errors import BadInput
from pamjax.model.registry import ALTERNATIVES, MECHANISMS
from pamjax.records.files import write_atomically

#: What a program may change with besides pamjax itself.
TRACING_PACKAGES = ("jax", "jaxlib", "equinox")

#: Seconds after which another process that has begun a program is waited for no longer.
LOCK_TIMEOUT = 240.0

#: Bytes of the checksum before a program.
CHECKSUM_BYTES = 32

#: Tracing holds Python's lock, compiling does not: one is traced at a time, and soon being compiled.
_tracing_lock = threading.Lock()


def load_or_compile(function: Any, *arguments: Any) -> Compiled:
    """A function of the arguments' leaves, compiled for arguments like these, by this process or another.

    Args:
        function: a jitted function; only those of pamjax itself are kept, whose sources are known.
        arguments: pytrees of JAX arrays.
    """
    leaves, shape = jax.tree_util.tree_flatten(arguments)
    flat = jax.jit(lambda *leaves: function(*jax.tree_util.tree_unflatten(shape, leaves)))
    file = _locate_program(function, arguments)
    if file is None:
        with _tracing_lock:
            program = flat.lower(*leaves)
        return program.compile()
    if not file.is_file():
        with _lock_program(file):
            # Another process may have been first.
            if not file.is_file():
                return _compile_and_store(flat, leaves, file)
    return _load_program(file, leaves) or _compile_and_store(flat, leaves, file)


def _compile_and_store(function: Wrapped, leaves: list, file: Path) -> Compiled:
    with _tracing_lock:
        exported = jax.export.export(function, platforms=["cpu"])(*leaves)
    program = _compile_exported(exported.call, leaves)
    # Full, deleted meanwhile, or another's: the next process compiles for itself.
    with suppress(OSError, BadInput), write_atomically(file) as temporary:
        body = bytes(exported.serialize())
        temporary.write_bytes(hashlib.sha256(body).digest() + body)
    return program


def _load_program(file: Path, leaves: list) -> Compiled | None:
    """A program that was kept; None where it cannot be read."""
    content = b""
    with suppress(OSError):
        content = file.read_bytes()
    checksum, body = content[:CHECKSUM_BYTES], content[CHECKSUM_BYTES:]
    if hashlib.sha256(body).digest() != checksum:
        return None
    return _compile_exported(jax.export.deserialize(bytearray(body)).call, leaves)


def _compile_exported(function: Callable, leaves: list) -> Compiled:
    return jax.jit(function).lower(*leaves).compile()


@contextmanager
def _lock_program(file: Path) -> Iterator[None]:
    """One process at a time, where the folder takes locks and nobody has stopped while holding one."""
    lock = FileLock(file.with_suffix(".lock"), timeout=LOCK_TIMEOUT)
    with suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    try:
        yield
    finally:
        lock.release()


def _locate_program(function: Any, arguments: tuple) -> Path | None:
    """Where a program is kept; None where it is not."""
    folder = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    is_own = all(owner.__module__.startswith("pamjax.") for owner in (function, *MECHANISMS, *ALTERNATIVES))
    leaves = jax.tree_util.tree_leaves(arguments)
    on_cpu = all(device.platform == "cpu" for leaf in leaves for device in leaf.devices())
    if not folder or "://" in folder or not (is_own and on_cpu and _are_sources_unchanged()):
        return None
    shapes = eqx.tree_pformat(arguments, width=10**6)
    function_name = f"{function.__module__}.{function.__qualname__}"
    name = hashlib.sha256("\n".join([function_name, shapes, _describe_tracer()]).encode()).hexdigest()
    return Path(folder) / "traced" / f"{name}.stablehlo"


def _list_sources() -> list[Path]:
    return sorted(Path(pamjax.__file__).parent.rglob("*.py"))


def _are_sources_unchanged() -> bool:
    """Whether no source was written since pamjax was imported: what is traced is what was imported."""
    sources = _list_sources()
    return bool(sources) and max(source.stat().st_mtime for source in sources) < pamjax.IMPORT_TIME


@cache
def _describe_tracer() -> str:
    """What traces: versions, and all that pamjax is made of."""
    sources, root = hashlib.sha256(), Path(pamjax.__file__).parent
    for source in _list_sources():
        sources.update(source.relative_to(root).as_posix().encode() + b"\0" + source.read_bytes())
    return "\n".join([*(f"{name} {version(name)}" for name in TRACING_PACKAGES), sources.hexdigest()])
