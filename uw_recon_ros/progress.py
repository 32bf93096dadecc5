"""Progress of long work: a bar on a terminal, plain lines in a log, JSON lines for programs, or nothing."""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterable, Iterator
from typing import Literal, TypeVar

T = TypeVar("T")
Manner = Literal["people", "json", "quiet"]
_LINE_EVERY_S = 5.0


def say(text: str) -> None:
    """Write a line to standard error."""
    sys.stderr.write(text + "\n")
    sys.stderr.flush()


class Progress:
    """Speaks to standard error.

    Parameters
    ----------
    manner : {'people', 'json', 'quiet'}
    """

    def __init__(self, manner: Manner = "people") -> None:
        self.manner = manner

    def line(self, text: str) -> None:
        """Say something that is not progress."""
        if self.manner == "json":
            say(json.dumps({"event": "note", "text": text}))
        elif self.manner == "people":
            say(text)

    def watch(self, items: Iterable[T], what: str, total: int, done: int = 0) -> Iterator[T]:
        """Yield `items`, telling how many of `total` there were, at which rate, and how long the rest will take.

        Parameters
        ----------
        items : iterable
        what : str
            What is counted, e.g. ``frames``.
        total : int
        done : int
            How many of these were there before.
        """
        if self.manner == "people" and sys.stderr.isatty():
            from tqdm import tqdm

            bar = "{desc}: {n}/{total} {bar} {rate_fmt}, {remaining} left"
            yield from tqdm(items, desc=what, total=total, initial=done, unit="", dynamic_ncols=True, bar_format=bar)
        elif self.manner == "quiet":
            yield from items
        else:
            yield from self._lines(items, what, total, done)

    def _lines(self, items: Iterable[T], what: str, total: int, done: int) -> Iterator[T]:
        started = said = time.monotonic()
        count = 0
        for count, item in enumerate(items, 1):
            yield item
            now = time.monotonic()
            if now - said >= _LINE_EVERY_S or done + count == total:
                said = now
                self._tell(what, done + count, total, count / max(now - started, 1e-9))

    def _tell(self, what: str, done: int, total: int, rate: float) -> None:
        left_s = (total - done) / rate
        if self.manner == "json":
            event = {"event": "progress", "what": what, "done": done, "total": total}
            say(json.dumps(event | {"per_second": round(rate, 4), "seconds_left": round(left_s, 1)}))
        else:
            say(f"{what}: {done} of {total}, {rate:.2f}/s, {_clock(left_s)} left")


def _clock(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
