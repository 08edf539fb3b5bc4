"""Compilation of programs in the background, once for all threads.

JAX compiles a function again in every thread that calls it before its first compilation ends. This module
prevents that. Programs of earlier processes are read from the cache (`aot_cache.py`).
"""

from __future__ import annotations

import threading
from collections.abc import Hashable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import jax

from pamjax.compile.aot_cache import load_or_compile
from pamjax.jit import get_default_device, keep_default_device

#: Maximum number of concurrent compilations.
_MAX_CONCURRENT_COMPILATIONS = 2

_compilations: dict[Hashable, Future] = {}
_compilations_lock = threading.Lock()
_compile_pool = ThreadPoolExecutor(_MAX_CONCURRENT_COMPILATIONS, thread_name_prefix="compile")


def start_compilation(function: Any, *arguments: Any) -> Future:
    """Return the future of a function compiled for arguments of these shapes; compile it only once.

    Args:
        function: a jitted function.
        arguments: pytrees of arrays.
    """
    leaves, shape = jax.tree_util.tree_flatten(arguments)
    key = (function, get_default_device(), shape, tuple((leaf.shape, leaf.dtype) for leaf in leaves))
    with _compilations_lock:
        if key not in _compilations:
            _compilations[key] = _compile_pool.submit(
                keep_default_device(load_or_compile), function, *arguments
            )
        return _compilations[key]


def run_compiled(function: Any, *arguments: Any) -> Any:
    """Return the function's value; compile the function first if necessary.

    Args:
        function: a function whose value is an array, or tuples, lists and dictionaries of arrays.
        arguments: pytrees of arrays.
    """
    return start_compilation(function, *arguments).result()(*jax.tree_util.tree_leaves(arguments))
