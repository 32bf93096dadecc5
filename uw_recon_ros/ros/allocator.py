"""Memory freed after a pair is kept for the next one.

The C library gives large blocks back to the system as soon as they are free, and takes them anew for the next image:
every page of them is then a page fault, in which the kernel fills it with zeros: ``test/benchmark/graph_load.py``
counts them.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Mapping

# malloc.h of glibc; see mallopt(3)
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD, _M_ARENA_MAX = -1, -3, -8
_LARGEST_BLOCK = 32 << 20  #: bytes, the most that glibc takes: larger blocks are given back all the same
_KEPT_FREE = 256 << 20  #: bytes that may lie free at the end of the heap
_CHOSEN = ("GLIBC_TUNABLES", "MALLOC_TRIM_THRESHOLD_", "MALLOC_MMAP_THRESHOLD_", "MALLOC_ARENA_MAX")


def keep_freed_memory(environment: Mapping[str, str] | None = None) -> bool:
    """Tell the C library to keep freed blocks, in one heap for all threads, unless the user has told it otherwise.

    Call before threads are made: those that have a heap of their own keep it.

    Parameters
    ----------
    environment : mapping
        ``os.environ`` by default.

    Returns
    -------
    bool
        Whether it does: glibc alone can be told.
    """
    environment = os.environ if environment is None else environment
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if os.name == "posix" else None
    if mallopt is None or any(environment.get(name) for name in _CHOSEN):
        return False
    told = ((_M_ARENA_MAX, 1), (_M_MMAP_THRESHOLD, _LARGEST_BLOCK), (_M_TRIM_THRESHOLD, _KEPT_FREE))
    return all(mallopt(option, value) == 1 for option, value in told)
