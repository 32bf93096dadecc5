"""SIGINT and SIGTERM noted, not obeyed at once, so that a process ends in order: soon, and in any case in time."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable
from types import FrameType

#: Seconds from the signal until the process leaves whatever it is doing.
PATIENCE_S = 1.5

_came = threading.Event()
_leave: Callable[[int], None] = os._exit


def note(leave: Callable[[int], None] = os._exit) -> None:
    """Note the signals from now on, for good. Call in the main thread; again to replace `leave`.

    Parameters
    ----------
    leave : callable
        Ends the process with exit code 0 from another thread, where the main thread does not come to it in time.
    """
    global _leave
    _leave = leave
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _on_signal)


def came() -> bool:
    """Whether one has come."""
    return _came.is_set()


def _on_signal(number: int, frame: FrameType | None) -> None:
    if not _came.is_set():
        _came.set()
        last_resort = threading.Timer(PATIENCE_S, lambda: _leave(0))
        last_resort.daemon = True
        last_resort.start()
