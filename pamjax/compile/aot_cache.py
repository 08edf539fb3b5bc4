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
from pamjax.records.files import write_beside

#: What a program may change with besides pamjax itself.
TRACERS = ("jax", "jaxlib", "equinox")

#: Seconds after which another process that has begun a program is waited for no longer.
PATIENCE = 240.0

#: Bytes of the checksum before a program.
CHECK = 32

#: Tracing holds Python's lock, compiling does not: one is traced at a time, and soon being compiled.
_tracing = threading.Lock()


def compiled(call: Any, *arguments: Any) -> Compiled:
    """A function of the arguments' leaves, compiled for arguments like these, by this process or another.

    Args:
        call: a jitted function; only those of pamjax itself are kept, whose sources are known.
        arguments: pytrees of JAX arrays.
    """
    leaves, shape = jax.tree_util.tree_flatten(arguments)
    flat = jax.jit(lambda *leaves: call(*jax.tree_util.tree_unflatten(shape, leaves)))
    file = _file(call, arguments)
    if file is None:
        with _tracing:
            program = flat.lower(*leaves)
        return program.compile()
    if not file.is_file():
        with _turn(file):
            # Another process may have been first.
            if not file.is_file():
                return _made(flat, leaves, file)
    return _read(file, leaves) or _made(flat, leaves, file)


def _made(flat: Wrapped, leaves: list, file: Path) -> Compiled:
    with _tracing:
        exported = jax.export.export(flat, platforms=["cpu"])(*leaves)
    program = _finished(exported.call, leaves)
    # Full, deleted meanwhile, or another's: the next process compiles for itself.
    with suppress(OSError, BadInput), write_beside(file) as beside:
        body = bytes(exported.serialize())
        beside.write_bytes(hashlib.sha256(body).digest() + body)
    return program


def _read(file: Path, leaves: list) -> Compiled | None:
    """A program that was kept; None where it cannot be read."""
    whole = b""
    with suppress(OSError):
        whole = file.read_bytes()
    check, body = whole[:CHECK], whole[CHECK:]
    if hashlib.sha256(body).digest() != check:
        return None
    return _finished(jax.export.deserialize(bytearray(body)).call, leaves)


def _finished(call: Callable, leaves: list) -> Compiled:
    return jax.jit(call).lower(*leaves).compile()


@contextmanager
def _turn(file: Path) -> Iterator[None]:
    """One process at a time, where the folder takes locks and nobody has stopped while holding one."""
    lock = FileLock(file.with_suffix(".lock"), timeout=PATIENCE)
    with suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    try:
        yield
    finally:
        lock.release()


def _file(call: Any, arguments: tuple) -> Path | None:
    """Where a program is kept; None where it is not."""
    folder = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    own = all(one.__module__.startswith("pamjax.") for one in (call, *MECHANISMS, *ALTERNATIVES))
    leaves = jax.tree_util.tree_leaves(arguments)
    here = all(device.platform == "cpu" for leaf in leaves for device in leaf.devices())
    if not folder or "://" in folder or not (own and here and _as_imported()):
        return None
    like = eqx.tree_pformat(arguments, width=10**6)
    named = f"{call.__module__}.{call.__qualname__}"
    name = hashlib.sha256("\n".join([named, like, _tracer()]).encode()).hexdigest()
    return Path(folder) / "traced" / f"{name}.stablehlo"


def _sources() -> list[Path]:
    return sorted(Path(pamjax.__file__).parent.rglob("*.py"))


def _as_imported() -> bool:
    """Whether no source was written since pamjax was imported: what is traced is what was imported."""
    sources = _sources()
    return bool(sources) and max(source.stat().st_mtime for source in sources) < pamjax.IMPORTED


@cache
def _tracer() -> str:
    """What traces: versions, and all that pamjax is made of."""
    sources, root = hashlib.sha256(), Path(pamjax.__file__).parent
    for source in _sources():
        sources.update(source.relative_to(root).as_posix().encode() + b"\0" + source.read_bytes())
    return "\n".join([*(f"{name} {version(name)}" for name in TRACERS), sources.hexdigest()])
