"""Warnings that do not fill the log."""

from __future__ import annotations

import threading
import time
from collections import Counter
from collections.abc import Callable

_MOST_KEYS = 256  # of lines kept apart by a throttle: a stream of ever new reasons must not fill the memory


class Throttle:
    """Lets the first of equal lines through, then one in a while, with the number of those kept back.

    Parameters
    ----------
    log : callable
        Called with the text.
    period_s : float
        Shortest time between lines of one key.
    clock : callable
        Monotonic seconds.
    """

    def __init__(
        self, log: Callable[[str], None], period_s: float = 10.0, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._log, self._period, self._clock = log, period_s, clock
        self._last: dict[str, float] = {}
        self._held: Counter[str] = Counter()
        self._lock = threading.Lock()
        self._silent = False

    def __call__(self, key: str, text: str) -> None:
        """Log `text`, or count it, lines of one `key` being equal."""
        with self._lock:
            now = self._clock()
            if self._silent or now - self._last.get(key, -self._period) < self._period:
                self._held[key] += 1
                return
            held = self._held.pop(key, 0)
            self._last.pop(key, None)
            self._last[key] = now
            if len(self._last) > _MOST_KEYS:
                oldest = next(iter(self._last))
                self._held.pop(oldest, None)
                del self._last[oldest]
            self._log(f"{text} ({held} more like it)" if held else text)

    def silence(self) -> None:
        """Log nothing more, whichever thread asks; a line on its way out is waited for."""
        with self._lock:
            self._silent = True
