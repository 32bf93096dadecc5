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
#: Exit code of a command that SIGINT has ended, as shells count: 128 and the signal's number.
INTERRUPTED = 130

_came = threading.Event()
_told = threading.Event()
_in_time = threading.Event()
_finishes = False


def leave(code: int) -> None:
    """End the process without the interpreter's farewell, which takes its time and trips over threads at work."""
    for stream in (sys.stdout, sys.stderr):
        with suppress(OSError, ValueError):  # closed, or nobody reads it
            stream.flush()
    os._exit(code)


def leave_interrupted(code: int) -> None:
    """Say so, once, and end the process with 130 whatever `code` is."""
    tell_interrupted("interrupted")
    leave(INTERRUPTED)


def tell_interrupted(text: str) -> None:
    """Say the one line about an interrupt, where it has not been said."""
    if not (came() and _told.is_set()):
        _told.set()
        sys.stderr.write(f"uw_recon: {text}\n")


def ignore_interrupts() -> None:
    """From now on SIGINT means nothing."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)


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


def interrupt_once(last_resort: Callable[[int], None]) -> None:
    """Let the first SIGINT raise `KeyboardInterrupt`, and further ones nothing. Call in the main thread.

    Parameters
    ----------
    last_resort : callable
        Ends the process from another thread, given 130, where the exception was lost on its way or compiled code
        goes on for longer than `PATIENCE_S`.
    """
    if not _came.is_set():
        global _last_resort
        _last_resort = last_resort
        sys.unraisablehook = _not_of_interrupts
        signal.signal(signal.SIGINT, _on_interrupt)


def _not_of_interrupts(lost: sys.UnraisableHookArgs) -> None:
    """An interrupt that a destructor swallowed is no news: the last resort obeys it."""
    if not issubclass(lost.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(lost)


def _on_interrupt(number: int, frame: FrameType | None) -> None:
    signal.signal(number, signal.SIG_IGN)
    _obey_in_time(INTERRUPTED)
    raise KeyboardInterrupt


def _obey_in_time(code: int) -> None:
    _came.set()
    timer = threading.Timer(PATIENCE_S, lambda: _last_resort(code))
    timer.daemon = True
    timer.start()


def came() -> bool:
    """Whether one has come."""
    return _came.is_set()


def finish_first() -> None:
    """From now on the first signal only asks for the end, for what was gathered is worth waiting for; a second one ends
    the process in time."""
    global _finishes
    _finishes = True


def _on_signal(number: int, frame: FrameType | None) -> None:
    if _finishes and not _came.is_set():
        _came.set()
    elif not _in_time.is_set():
        _in_time.set()
        _obey_in_time(0)
