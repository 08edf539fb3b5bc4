"""Parallel map over threads. Compiled programs release Python's global lock while they run."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from threadpoolctl import threadpool_limits

from pamjax.jit import keep_default_device

A = TypeVar("A")
B = TypeVar("B")

#: Maximum number of threads.
_MAX_THREADS = 4


#: Decorator: linear algebra in one thread. A QR of some thousand rows and a few columns has many small steps.
#: Several threads wait for each other in each step, and take four times as long.
use_one_blas_thread = threadpool_limits.wrap(limits=1, user_api="blas")


def parallel_map(function: Callable[[A], B], items: Iterable[A]) -> list[B]:
    """Return the function's value for each item, in order, computed on several cores.

    All threads have the default device of the caller.

    >>> parallel_map(abs, [-1, 2, -3])
    [1, 2, 3]
    """
    pool = ThreadPoolExecutor(min(os.cpu_count() or 1, _MAX_THREADS))
    try:
        # One linear-algebra thread per item: more threads would compete for the cores.
        with threadpool_limits(1, user_api="blas"):
            return list(pool.map(keep_default_device(function), items))
    finally:
        # After an interruption, only the items that already run are completed.
        pool.shutdown(cancel_futures=True)
