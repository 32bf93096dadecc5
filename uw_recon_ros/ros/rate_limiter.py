"""At most so many a second, evenly: for cameras faster than what can be made of their images."""

from __future__ import annotations

import time
from collections.abc import Callable

_SLACK = 0.25  # of a period that a moment may come early: cameras are not exact


class Pace:
    """Says which of the pairs that come are worked on.

    Whoever is refused costs nothing, and who is let through is fresh: nothing is kept for later. On a machine with too
    few cores for all frames this leaves the time for the stages that follow, where refusing them further down would
    waste what was spent on them before.

    Parameters
    ----------
    clock : callable
        Monotonic seconds.

    Attributes
    ----------
    limit_hz : float
        0: none.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self.limit_hz = 0.0
        self._due, self._begun = float("-inf"), False

    def lets_through(self) -> bool:
        """Whether one that comes now may pass."""
        if self.limit_hz <= 0:
            return True
        now, period = self._clock(), 1.0 / self.limit_hz
        if now < self._due - _SLACK * period:
            return False
        behind = min(now - self._due, period)  # made up for, but no more than one of them
        self._due = now + period - (behind if self._begun else 0.0)
        self._begun = True
        return True
