"""A problem's two programs, compiled side by side and once, however many threads ask for them.

JAX compiles a function anew in every thread that calls it before the first is done. What an earlier process
has traced, or another is tracing, is read (`traced.py`).
"""

from __future__ import annotations

import threading
from collections.abc import Hashable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import jax

from pamjax.compile.aot_cache import load_or_compile

#: Programs that are compiled at the same time.
MAX_CONCURRENT_COMPILATIONS = 2

_compilations: dict[Hashable, Future] = {}
_compilations_lock = threading.Lock()
_compile_pool = ThreadPoolExecutor(MAX_CONCURRENT_COMPILATIONS, thread_name_prefix="compile")


def start_compilation(function: Any, *arguments: Any) -> Future:
    """Compile a function for arguments like these, no more than once.

    Args:
        function: a jitted function.
        arguments: pytrees of arrays.
    """
    leaves, shape = jax.tree_util.tree_flatten(arguments)
    key = (function, shape, tuple((leaf.shape, leaf.dtype) for leaf in leaves))
    with _compilations_lock:
        if key not in _compilations:
            _compilations[key] = _compile_pool.submit(load_or_compile, function, *arguments)
        return _compilations[key]


def run_compiled(function: Any, *arguments: Any) -> Any:
    """What the function gives, once it is compiled."""
    return start_compilation(function, *arguments).result()(*jax.tree_util.tree_leaves(arguments))
