"""Independent pieces of work side by side: compiled programs leave Python's lock alone while they run."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

from threadpoolctl import threadpool_limits

A = TypeVar("A")
B = TypeVar("B")

#: Most threads.
MAX_THREADS = 4


def parallel_map(function: Callable[[A], B], items: Iterable[A]) -> list[B]:
    """What a function gives for each item, in their order, on all cores.

    >>> parallel_map(abs, [-1, 2, -3])
    [1, 2, 3]
    """
    pool = ThreadPoolExecutor(min(os.cpu_count() or 1, MAX_THREADS))
    try:
        # Each has a core: threads of linear algebra besides would wait for each other.
        with threadpool_limits(1, user_api="blas"):
            return list(pool.map(function, items))
    finally:
        # An interruption waits for what runs, not for what has not begun.
        pool.shutdown(cancel_futures=True)
