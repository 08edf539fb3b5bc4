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

from pamjax.compile.aot_cache import compiled

#: Programs that are compiled at the same time.
ABREAST = 2

_begun: dict[Hashable, Future] = {}
_lock = threading.Lock()
_compilers = ThreadPoolExecutor(ABREAST, thread_name_prefix="compile")


def begin(call: Any, *arguments: Any) -> Future:
    """Compile a function for arguments like these, no more than once.

    Args:
        call: a jitted function.
        arguments: pytrees of arrays.
    """
    leaves, shape = jax.tree_util.tree_flatten(arguments)
    key = (call, shape, tuple((leaf.shape, leaf.dtype) for leaf in leaves))
    with _lock:
        if key not in _begun:
            _begun[key] = _compilers.submit(compiled, call, *arguments)
        return _begun[key]


def ready(call: Any, *arguments: Any) -> Any:
    """What the function gives, once it is compiled."""
    return begin(call, *arguments).result()(*jax.tree_util.tree_leaves(arguments))
