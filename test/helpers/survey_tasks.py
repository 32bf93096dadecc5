"""Work for executors, importable by their processes."""

from __future__ import annotations

import os
import signal
import time
from pathlib import Path


def square(number: int) -> int:
    return number * number


def process_number(number: int) -> int:
    time.sleep(0.05)
    return os.getpid()


def die_if_seven(number: int) -> int:
    if number == 7:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def die_once(marker: str) -> str:
    """The first time, leave a mark and die."""
    path = Path(marker)
    if not path.exists():
        path.write_text("died here")
        os.kill(os.getpid(), signal.SIGKILL)
    return path.name


def full_disk(number: int) -> int:
    if number == 3:
        raise OSError(28, "No space left on device")
    return number


def threads(number: int) -> str:
    return os.environ.get("OMP_NUM_THREADS", "")


def note_and_sleep(path: str) -> None:
    Path(path).write_text(str(os.getpid()))
    time.sleep(60)
