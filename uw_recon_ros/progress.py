"""Progress of long work: a bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator
from typing import TypeVar

T = TypeVar("T")
_LINE_EVERY_S = 5.0


def progress(items: Iterable[T], what: str, total: int | None = None) -> Iterator[T]:
    """Yield `items`, telling standard error how far it is.

    Parameters
    ----------
    items : iterable
    what : str
        What is counted, e.g. ``frames``.
    total : int, optional
        How many there will be.
    """
    if sys.stderr.isatty():
        from tqdm import tqdm

        yield from tqdm(items, desc=what, total=total, unit="", dynamic_ncols=True, leave=False)
        return
    started = said = time.monotonic()
    count = 0
    for count, item in enumerate(items, 1):
        yield item
        now = time.monotonic()
        if now - said >= _LINE_EVERY_S:
            said = now
            say(f"{what}: {count}{f' of {total}' if total else ''}, {count / (now - started):.1f}/s")
    say(f"{what}: {count} in {time.monotonic() - started:.1f} s")


def say(text: str) -> None:
    """Write a line to standard error."""
    sys.stderr.write(text + "\n")
    sys.stderr.flush()
