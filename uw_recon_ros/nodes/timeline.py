"""Recorded time against the wall clock: rate, pause, steps. Pure: the wall's time is handed in."""

from __future__ import annotations

_NS = 1e9


class Timeline:
    """Says when a recorded moment is due.

    Parameters
    ----------
    start_ns : int
        Recorded time at which playing begins, ns.
    rate : float
        Recorded seconds a second.

    Attributes
    ----------
    paused : bool
    """

    def __init__(self, start_ns: int, rate: float) -> None:
        self._rate = rate
        self._anchor_ns, self._anchor_s = start_ns, 0.0
        self.paused = True
        self._stepped: set[str] | None = None

    def now_ns(self, wall_s: float) -> int:
        """Recorded time at wall time `wall_s`."""
        if self.paused:
            return self._anchor_ns
        return self._anchor_ns + round((wall_s - self._anchor_s) * self._rate * _NS)

    def due_s(self, recorded_ns: int) -> float:
        """Wall time at which a recorded moment is due, while not paused."""
        return self._anchor_s + (recorded_ns - self._anchor_ns) / (self._rate * _NS)

    def pause(self, wall_s: float) -> None:
        """Stop the recorded time."""
        self._anchor_ns = self.now_ns(wall_s)
        self.paused = True

    def resume(self, wall_s: float) -> None:
        """Let the recorded time go on from where it stands."""
        if self.paused:
            self._anchor_s, self.paused, self._stepped = wall_s, False, None

    def begin_step(self) -> None:
        """Allow one message of each topic while paused."""
        self._stepped = set()

    @property
    def step_begins(self) -> bool:
        """Whether a step was asked for, and nothing sent yet."""
        return self._stepped is not None and not self._stepped

    def take_step(self, topic: str, recorded_ns: int) -> bool:
        """Whether the step under way includes the next message; if so the recorded time moves to it.

        The step ends before the first topic that would come a second time.
        """
        if self._stepped is None or topic in self._stepped:
            self._stepped = None
            return False
        self._stepped.add(topic)
        self._anchor_ns = recorded_ns
        return True

    def jump(self, recorded_ns: int, wall_s: float) -> None:
        """Set the recorded time, paused or not: the start of another round."""
        self._anchor_ns, self._anchor_s = recorded_ns, wall_s
