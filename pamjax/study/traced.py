"""Traced programs, kept on disk beside the compiled ones: to trace takes longer than to read them.

JAX finds a compiled program by what was traced, so every process traces anew, for some twenty seconds. Here
the traced program is kept (StableHLO) under a name made of all that it depends on: the function, its
arguments but for their values, the sources of pamjax, and the versions of what traces. It is written once the
program is compiled; processes that want it meanwhile wait, rather than compile it as well.
"""

from __future__ import annotations

import hashlib
import threading
from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import equinox as eqx
import jax
from filelock import FileLock
from jax.stages import Compiled

import pamjax
from pamjax.records.files import write_beside

#: What a program may change with besides pamjax itself.
TRACERS = ("jax", "jaxlib", "equinox", "lineax", "optimistix")

#: Tracing holds Python's lock, compiling does not: one is traced at a time, and soon being compiled.
_tracing = threading.Lock()


def compiled(call: Any, *arguments: Any) -> Compiled:
    """A function of the arguments' leaves, compiled for arguments like these, by this process or another.

    Args:
        call: a jitted function; only those of pamjax itself are kept, whose sources are known.
        arguments: pytrees of arrays.
    """
    leaves, shape = jax.tree_util.tree_flatten(arguments)
    flat = jax.jit(lambda *leaves: call(*jax.tree_util.tree_unflatten(shape, leaves)))
    file = _file(call, arguments)
    if file is None:
        with _tracing:
            program = flat.lower(*leaves)
        return program.compile()
    if file.is_file():
        return _read(file, leaves)
    file.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(file.with_suffix(".lock")):
        if file.is_file():
            return _read(file, leaves)
        with _tracing:
            exported = jax.export.export(flat)(*leaves)
        program = _finished(exported.call, leaves)
        with write_beside(file) as beside:
            beside.write_bytes(exported.serialize())
    return program


def _read(file: Path, leaves: list) -> Compiled:
    return _finished(jax.export.deserialize(bytearray(file.read_bytes())).call, leaves)


def _finished(call: Callable, leaves: list) -> Compiled:
    return jax.jit(call).lower(*leaves).compile()


def _file(call: Any, arguments: tuple) -> Path | None:
    """Where a program is kept; None where it is not."""
    folder = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    if not folder or not call.__module__.startswith("pamjax."):
        return None
    like = eqx.tree_pformat(arguments, width=10**6)
    named = f"{call.__module__}.{call.__qualname__} on {jax.default_backend()}"
    name = hashlib.sha256("\n".join([named, like, _tracer()]).encode()).hexdigest()
    return Path(folder) / "traced" / f"{name}.stablehlo"


@cache
def _tracer() -> str:
    """What traces: versions, and all that pamjax is made of."""
    root = Path(pamjax.__file__).parent
    sources = hashlib.sha256()
    for source in sorted(root.rglob("*.py")):
        sources.update(source.relative_to(root).as_posix().encode() + b"\0" + source.read_bytes())
    return "\n".join([*(f"{name} {version(name)}" for name in TRACERS), sources.hexdigest()])
