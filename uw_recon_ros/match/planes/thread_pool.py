"""A few threads, made when first needed, that share a list of jobs."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from concurrent.futures import ThreadPoolExecutor
from itertools import pairwise
from typing import TypeVar

T = TypeVar("T")
_lock = threading.Lock()
_pools: dict[int, ThreadPoolExecutor] = {}


def _pool(threads: int) -> ThreadPoolExecutor:
    with _lock:
        if threads not in _pools:
            _pools[threads] = ThreadPoolExecutor(threads, thread_name_prefix="match")
        return _pools[threads]


def run_parallel(function: Callable[[T], None], jobs: Iterable[T], threads: int) -> None:
    """Call `function` for every job, in `threads` threads; return when all are done.

    The jobs must not depend on each other. One thread works without a pool. May be called from any thread, but not
    from within a job.
    """
    if threads == 1:
        for job in jobs:
            function(job)
        return
    for _ in _pool(threads).map(function, jobs):
        pass


def row_bands(rows: int, count: int) -> list[tuple[int, int]]:
    """Cut `rows` rows into at most `count` row_bands of nearly equal height: (first, one past the last)."""
    edges = [rows * i // count for i in range(count + 1)]
    return [(a, b) for a, b in pairwise(edges) if b > a]
