"""Segments of shared memory that killed processes left behind.

Fast DDS removes a segment when its process ends in order; after SIGKILL, or a crash, its 64 MiB stay until somebody
removes them. A living owner holds a lock (flock) on the file ``SEGMENT_el`` beside its segment, and the kernel lets go
of it however the owner ends: that tells orphans apart, as it does for ``fastdds shm clean``.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import time
from pathlib import Path

_LOCK = re.compile(r"(fast(?:rtps|dds)_[0-9a-f]{16})_el")
_YOUNG_S = 10.0  # an owner makes the file first and locks it then


def remove_orphans(folder: Path, now_s: float | None = None) -> int:
    """Remove this user's segments that have no owner any more.

    Parameters
    ----------
    folder : path
        Where shared memory is mounted.
    now_s : float or None
        Seconds since the epoch; None: the clock's.

    Returns
    -------
    int
        Bytes freed. What cannot be looked at or removed is left alone.
    """
    now_s = time.time() if now_s is None else now_s
    freed = 0
    with contextlib.suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            match = _LOCK.fullmatch(entry.name)
            if match is not None:
                freed += _remove(folder / match[1], Path(entry.path), now_s)
    return freed


def _remove(segment: Path, lock: Path, now_s: float) -> int:
    """Remove a segment unless its owner lives; the bytes freed."""
    with contextlib.suppress(OSError):  # among them BlockingIOError: owned
        descriptor = os.open(lock, os.O_RDONLY | os.O_NOFOLLOW | os.O_CLOEXEC)
        try:
            status = os.fstat(descriptor)
            if status.st_uid != os.getuid() or now_s - status.st_mtime < _YOUNG_S:
                return 0
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            size = segment.stat().st_size if segment.exists() else 0
            segment.unlink(missing_ok=True)
            lock.unlink(missing_ok=True)
            return size
        finally:
            os.close(descriptor)
    return 0
