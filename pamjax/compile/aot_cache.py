"""Cache of traced programs (StableHLO) on disk.

JAX finds a compiled program by its trace. Every process therefore traces again, which takes about twenty
seconds. This cache stores the trace. Its file name has the function and two hashes. One is of the sources of
pamjax and the versions of JAX and Equinox, the other of the shapes and types of the arguments. The file is
written after the program is compiled. Other processes that need the same program wait for it. If the folder
cannot be used, a process compiles without the cache.

The cache is not used if the sources changed after the import, or for devices other than the CPU. Nor is it
used if the library has a mechanism from outside pamjax. It does not detect code that is patched at run time.
"""

from __future__ import annotations

import hashlib
import re
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
from pamjax.jit import get_default_device, list_compiler_options
from pamjax.model.registry import ALTERNATIVE_EQUATIONS, MECHANISMS
from pamjax.records.files import write_atomically

#: Packages whose versions are part of a program's name.
_TRACING_PACKAGES = ("jax", "jaxlib", "equinox")

#: Longest time to wait for a program of another process, s.
LOCK_TIMEOUT = 240.0

#: Largest number of characters of the function in a file name.
_MAX_FUNCTION_NAME = 100

#: Length of the checksum at the start of a file, bytes.
_CHECKSUM_BYTES = 32

#: Lock for tracing: tracing needs Python's global lock, compilation does not. Threads trace one by one.
_tracing_lock = threading.Lock()


def load_or_compile(function: Any, *arguments: Any) -> Compiled:
    """Return the function of the arguments' leaves, compiled for arguments of these shapes.

    Args:
        function: a jitted function; only functions of pamjax are cached, since their sources are hashed.
        arguments: pytrees of JAX arrays.
    """
    leaves, shape = jax.tree_util.tree_flatten(arguments)
    flat = jax.jit(lambda *leaves: function(*jax.tree_util.tree_unflatten(shape, leaves)))
    file = _locate_program(function, arguments)
    if file is None:
        with _tracing_lock:
            program = flat.lower(*leaves)
        return program.compile(compiler_options=list_compiler_options())
    if not file.is_file():
        with _lock_program(file):
            # Another process may have written the file while this process waited for the lock.
            if not file.is_file():
                return _compile_and_store(flat, leaves, file)
    return _load_program(file, leaves) or _compile_and_store(flat, leaves, file)


def has_programs(package: str) -> bool:
    """Return whether the cache has programs of a package, traced by these versions and sources.

    Args:
        package: for example "pamjax.diagnosis".
    """
    folder = _get_folder()
    return folder is not None and any(folder.glob(f"{package}.*-{_hash_tracer()}-*.stablehlo"))


def _compile_and_store(function: Wrapped, leaves: list, file: Path) -> Compiled:
    with _tracing_lock:
        exported_program = jax.export.export(function, platforms=["cpu"])(*leaves)
    program = _compile_exported(exported_program.call, leaves)
    # Ignore a full, deleted or protected folder: the next process compiles again.
    with suppress(OSError, BadInput), write_atomically(file) as temporary:
        body = bytes(exported_program.serialize())
        temporary.write_bytes(_compute_checksum(file, body) + body)
    return program


def _load_program(file: Path, leaves: list) -> Compiled | None:
    """Return a cached program, or None if its file cannot be read or has a program of another name."""
    content = b""
    with suppress(OSError):
        content = file.read_bytes()
    checksum, body = content[:_CHECKSUM_BYTES], content[_CHECKSUM_BYTES:]
    if _compute_checksum(file, body) != checksum:
        return None
    # JAX raises errors of many types for a file of another format, or arguments of another type.
    with suppress(Exception):
        return _compile_exported(jax.export.deserialize(bytearray(body)).call, leaves)
    return None


def _compute_checksum(file: Path, body: bytes) -> bytes:
    """Return the checksum of a program; its name is included, so that no program replaces another one."""
    return hashlib.sha256(file.name.encode() + b"\0" + body).digest()


def _compile_exported(function: Callable, leaves: list) -> Compiled:
    return jax.jit(function).lower(*leaves).compile(compiler_options=list_compiler_options())


@contextmanager
def _lock_program(file: Path) -> Iterator[None]:
    """Lock a program against other processes; without a lock if the folder does not support locks."""
    lock = FileLock(file.with_suffix(".lock"), timeout=LOCK_TIMEOUT)
    with suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        lock.acquire()
    try:
        yield
    finally:
        lock.release()


def _locate_program(function: Any, arguments: tuple) -> Path | None:
    """Return the file of a program, or None if it is not cached."""
    folder = _get_folder()
    owners = (function, *MECHANISMS, *ALTERNATIVE_EQUATIONS)
    is_own = all(owner.__module__.startswith("pamjax.") for owner in owners)
    leaves = jax.tree_util.tree_leaves(arguments)
    # JAX copies arrays to the device of the program, unless the caller fixed their device.
    devices = {
        get_default_device(),
        *(device for leaf in leaves if isinstance(leaf, jax.Array) for device in leaf.devices()),
    }
    on_cpu = all(device.platform == "cpu" for device in devices)
    if folder is None or not (is_own and on_cpu and _are_sources_unchanged()):
        return None
    shapes = eqx.tree_pformat(arguments, width=10**6)
    function_name = f"{function.__module__}.{function.__qualname__}"
    name = hashlib.sha256(f"{function_name}\n{shapes}".encode()).hexdigest()
    readable_name = re.sub(r"[^\w.]", "_", function_name)[:_MAX_FUNCTION_NAME]
    return folder / f"{readable_name}-{_hash_tracer()}-{name}.stablehlo"


def _get_folder() -> Path | None:
    """Return the folder of traced programs, or None without a local cache folder."""
    folder = jax.config.jax_compilation_cache_dir  # pyright: ignore[reportAttributeAccessIssue]
    return None if not folder or "://" in folder else Path(folder) / "traced"


def _hash_tracer() -> str:
    return hashlib.sha256(_describe_tracer().encode()).hexdigest()


def _list_sources() -> list[Path]:
    return sorted(Path(pamjax.__file__).parent.rglob("*.py"))


def _are_sources_unchanged() -> bool:
    """Return whether no source file changed since pamjax was imported."""
    sources = _list_sources()
    return bool(sources) and max(source.stat().st_mtime for source in sources) < pamjax.IMPORT_TIME


@cache
def _describe_tracer() -> str:
    """Return the versions of the tracing packages and a hash of pamjax's sources."""
    sources, root = hashlib.sha256(), Path(pamjax.__file__).parent
    for source in _list_sources():
        sources.update(source.relative_to(root).as_posix().encode() + b"\0" + source.read_bytes())
    return "\n".join([*(f"{name} {version(name)}" for name in _TRACING_PACKAGES), sources.hexdigest()])
