"""What a node knows about itself: counted from any thread, said once a second on ``/diagnostics`` (REP 107)."""

from __future__ import annotations

import statistics
import threading
import time
from collections import Counter, defaultdict, deque
from collections.abc import Callable
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
#: The graph's way to keep up, no faults: frames overtaken here, and what belonged to frames overtaken elsewhere.
SUPERSEDED, NO_PARTNER = "superseded by newer", "no partner within tolerance"
_WINDOW_TICKS = 10
_RECENT = 50


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

    def __call__(self, key: str, text: str) -> None:
        """Log `text`, or count it, lines of one `key` being equal."""
        with self._lock:
            now = self._clock()
            if now - self._last.get(key, -self._period) < self._period:
                self._held[key] += 1
                return
            held, self._last[key] = self._held.pop(key, 0), now
        self._log(f"{text} ({held} more like it)" if held else text)


class Diagnostics:
    """Counters of one node. All methods may be called from any thread.

    Parameters
    ----------
    on_problem : callable
        Called with key and text when a standing problem begins.
    """

    def __init__(self, on_problem: Callable[[str, str], None] = lambda key, text: None) -> None:
        self._on_problem = on_problem
        self._lock = threading.Lock()
        self._now: Counter[str] = Counter()
        self._ticks: deque[Counter[str]] = deque(maxlen=_WINDOW_TICKS)
        self._drops: Counter[str] = Counter()
        self._last_drop = ""
        self._facts: dict[str, str] = {}
        self._problems: dict[str, str] = {}
        self._recent: defaultdict[str, deque[float]] = defaultdict(lambda: deque(maxlen=_RECENT))

    def count(self, what: str, number: int = 1) -> None:
        """Count events whose rate is shown, e.g. ``in left/image_raw``."""
        with self._lock:
            self._now[what] += number

    def drop(self, reason: str, text: str = "", number: int = 1) -> None:
        """Count frames given up, with the last one's words."""
        with self._lock:
            self._drops[reason] += number
            self._now["skipped" if reason in (SUPERSEDED, NO_PARTNER) else "failed"] += number
            self._last_drop = text or self._last_drop

    def measure(self, what: str, value: float) -> None:
        """Note a value whose median and maximum are shown, e.g. ``work s``."""
        with self._lock:
            self._recent[what].append(value)

    def say(self, **facts: Any) -> None:
        """Set what is known of the last frame, e.g. ``density="0.91"``."""
        with self._lock:
            self._facts.update({name: str(value) for name, value in facts.items()})

    def problem(self, key: str, text: str | None) -> None:
        """Set a standing problem, or clear it with None."""
        with self._lock:
            begins = text is not None and key not in self._problems
            if text is None:
                self._problems.pop(key, None)
            else:
                self._problems[key] = text
        if begins and text is not None:
            self._on_problem(key, text)

    @property
    def drops(self) -> dict[str, int]:
        """Frames given up since the start, by reason."""
        with self._lock:
            return dict(self._drops)

    def tick(self, name: str, hardware_id: str = "") -> DiagnosticStatus:
        """Close the current second and describe everything.

        Parameters
        ----------
        name : str
            Of the status, e.g. ``/disparity_node``.
        hardware_id : str
        """
        with self._lock:
            now, self._now = self._now, Counter()
            self._ticks.append(now)
            level, message = self._verdict(now)
            values = {**self._facts, **self._rates(), **self._spreads(), **self._dropped(), **self._problems}
        pairs = [KeyValue(key=key, value=value) for key, value in values.items()]
        return DiagnosticStatus(level=level, name=name, message=message, hardware_id=hardware_id, values=pairs)

    def _verdict(self, now: Counter[str]) -> tuple[bytes, str]:
        if now["failed"] and not now["done"]:
            return ERROR, self._last_drop or "every frame dropped"
        if self._problems:
            return WARN, "; ".join(self._problems.values())
        if now["failed"]:
            return WARN, self._last_drop or "frames dropped"
        return OK, "working" if any(tick["done"] for tick in self._ticks) else "idle"

    def _rates(self) -> dict[str, str]:
        seconds = len(self._ticks)
        names = sorted(set().union(*self._ticks) - {"failed", "skipped", "done"})
        return {f"{name} [Hz]": f"{sum(tick[name] for tick in self._ticks) / seconds:.2f}" for name in names}

    def _spreads(self) -> dict[str, str]:
        return {
            what: f"median {statistics.median(values):.4g}, max {max(values):.4g}"
            for what, values in self._recent.items()
        }

    def _dropped(self) -> dict[str, str]:
        dropped = {f"dropped: {reason}": str(number) for reason, number in sorted(self._drops.items())}
        if self._last_drop:
            dropped["last drop"] = self._last_drop
        return {"dropped": str(sum(self._drops.values())), **dropped}
