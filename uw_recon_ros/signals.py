"""SIGINT and SIGTERM noted, not obeyed at once, so that a process ends in order: soon, and in any case in time."""

from __future__ import annotations

import os
import signal
import sys
import threading
from collections.abc import Callable
from contextlib import suppress
from types import FrameType

#: Seconds from the signal until the process leaves whatever it is doing.
PATIENCE_S = 1.2

_came = threading.Event()


def leave(code: int) -> None:
    """End the process without the interpreter's farewell, which takes its time and trips over threads at work."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # closed, or nobody reads it
            stream.flush()
    os._exit(code)


_last_resort: Callable[[int], None] = leave


def note(last_resort: Callable[[int], None] = leave) -> None:
    """Note the signals from now on, for good. Call in the main thread; again to replace `last_resort`.

    Parameters
    ----------
    last_resort : callable
        Ends the process with exit code 0 from another thread, where the main thread does not come to it in time.
    """
    global _last_resort
    _last_resort = last_resort
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _on_signal)


def came() -> bool:
    """Whether one has come."""
    return _came.is_set()


def _on_signal(number: int, frame: FrameType | None) -> None:
    if not _came.is_set():
        _came.set()
        timer = threading.Timer(PATIENCE_S, lambda: _last_resort(0))
        timer.daemon = True
        timer.start()
