"""Traced programs, kept on disk beside the compiled ones: to trace takes longer than to read them.

JAX finds a compiled program by what was traced, so every process traces anew, for some twenty seconds. Here
the traced program is kept (StableHLO) under a name made of all that it depends on: the function, its
arguments but for their values, the sources of pamjax, and the versions of what traces. Written whole or not
at all.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any

import equinox as eqx
import jax

import pamjax
from pamjax.records.files import write_beside

#: What a program may change with besides pamjax itself.
TRACERS = ("jax", "jaxlib", "equinox", "lineax", "optimistix")


def traced(call: Any, *arguments: Any) -> Callable[..., Any]:
    """A function of the arguments' leaves, traced for arguments like these, here or by an earlier process.

    Args:
        call: a jitted function; only those of pamjax itself are kept, whose sources are known.
        arguments: pytrees of arrays.
    """
    leaves, shape = jax.tree_util.tree_flatten(arguments)
    flat = jax.jit(lambda *leaves: call(*jax.tree_util.tree_unflatten(shape, leaves)))
    file = _file(call, arguments)
    if file is None:
        return flat
    if file.is_file():
        return jax.export.deserialize(bytearray(file.read_bytes())).call
    exported = jax.export.export(flat)(*leaves)
    file.parent.mkdir(exist_ok=True)
    with write_beside(file) as beside:
        beside.write_bytes(exported.serialize())
    return exported.call


def _file(call: Any, arguments: tuple) -> Path | None:
    """Where a program is kept; None where it is not."""
    folder = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    if not folder or not call.__module__.startswith("pamjax."):
        return None
    like = eqx.tree_pformat(arguments, width=10**6)
    named = f"{call.__module__}.{call.__qualname__} on {jax.default_backend()}"
    name = hashlib.sha256("\n".join([named, like, _tracer()]).encode()).hexdigest()
    return Path(folder) / "traced" / name


@cache
def _tracer() -> str:
    """What traces: versions, and all that pamjax is made of."""
    root = Path(pamjax.__file__).parent
    sources = hashlib.sha256()
    for source in sorted(root.rglob("*.py")):
        sources.update(source.relative_to(root).as_posix().encode() + b"\0" + source.read_bytes())
    return "\n".join([*(f"{name} {version(name)}" for name in TRACERS), sources.hexdigest()])
