"""What a node knows about itself: counted from any thread, said once a second on ``/diagnostics`` (REP 107).

Keys of the status that every stage node publishes under its full name, one value each; rates are means over the last
ten seconds, spreads are of the last fifty frames, numbers of drops since the start of the node:

| key | value |
| --- | --- |
| ``state`` | of the lifecycle: ``unconfigured``, ``inactive``, ``active``, ``finalized`` |
| ``idle [s]`` | how long nothing has come in nor been worked on; 0 while something is under way, warm-up included |
| ``warm_up`` | ``running`` while kernels are compiled or fetched, then ``done``; absent while unconfigured |
| ``in TOPIC [Hz]``, ``in groups [Hz]`` | messages received; complete groups (pairs and what goes with them) |
| ``done [Hz]``, ``out TOPIC [Hz]`` | frames worked on to the end; messages sent |
| ``dropped [Hz]``, ``dropped``, ``dropped: REASON`` | frames given up: rate, number, number by reason |
| ``last drop`` | why the last one was, where there is more to say than the reason |
| ``last drop code`` | of that reason, see `uw_recon_ros.findings.Code` |
| ``codes`` | of all standing findings, separated by commas; each is a key as well, with its text |
| ``work [s]``, ``work p95 [s]``, ``work max [s]`` | time a frame was worked on: median, 95th percentile, most |
| ``effort`` | of the matcher, spent on the last frame |
| ``target [Hz]``, ``possible [Hz]`` | ``target_rate_hz``, where set, and the rate that the last frame's work allows |
| ``obstacles``, ``range`` | what was told on them last, or the cause of their silence |
| ``latency [s]``, ``latency p95 [s]``, ``latency max [s]`` | from the stamp of the left image to the end of the work |

Beside these stand facts of the last frame and settings in use (``effort``, ``density``, ``row_error_median_px``, ...)
and standing problems, a sentence each (``silent``, ``unpaired``, ``scale``, ``rectification``, ``transition``, ...).
Latencies are left out while stamps are not of the node's clock. The level is ERROR when all frames of the last second
failed or a transition did, WARN with any problem or failure; frames overtaken by newer ones are neither.
"""

from __future__ import annotations

import math
import statistics
import threading
import time
from collections import Counter, defaultdict, deque
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from diagnostic_msgs.msg import DiagnosticStatus, KeyValue

from uw_recon_ros.findings import Code, Finding

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
#: The graph's way to keep up, no faults: frames overtaken here, and what belonged to frames overtaken elsewhere.
SUPERSEDED, NO_PARTNER = "superseded by newer", "no partner within tolerance"
#: Nor is what was under way, or waiting, when the node was deactivated.
DEACTIVATED = "no longer wanted: deactivated, or nobody listens"
#: What `max_rate_hz` asks for.
PASSED_OVER = "passed over: more than max_rate_hz"
_NO_FAULT = (SUPERSEDED, NO_PARTNER, DEACTIVATED, PASSED_OVER)
#: Key by which others see that nothing is left to do.
IDLE = "idle [s]"
_WINDOW_TICKS = 10
_RECENT = 50


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
        self._last_reason = ""
        self._last_drop = ""
        self._last_code = ""
        self._findings: dict[str, tuple[Finding, ...]] = {}
        self._facts: dict[str, str] = {}
        self._ends: dict[str, str] = {}
        self._problems: dict[str, str] = {}
        self._recent: defaultdict[str, deque[float]] = defaultdict(lambda: deque(maxlen=_RECENT))
        self._busy_at = time.monotonic()

    def count(self, what: str, number: int = 1) -> None:
        """Count events whose rate is shown, e.g. ``in left/image_raw``."""
        with self._lock:
            self._now[what] += number
            self._busy_at = time.monotonic()

    def drop(self, reason: str, text: str = "", number: int = 1, code: Code | None = None) -> None:
        """Count frames given up, with the last one's words."""
        with self._lock:
            self._drops[reason] += number
            self._now["skipped" if reason in _NO_FAULT else "failed"] += number
            if text or reason not in _NO_FAULT:  # the words of an older drop would name a cause that is gone
                self._last_reason, self._last_drop, self._last_code = reason, text, str(code or "")
            self._busy_at = time.monotonic()

    def measure(self, what: str, value: float) -> None:
        """Note seconds whose median, 95th percentile and maximum are shown, e.g. of ``work``."""
        with self._lock:
            self._recent[what].append(value)

    def say(self, **facts: Any) -> None:
        """Set what is known of the last frame, e.g. ``density="0.91"``; None: no longer known."""
        with self._lock:
            self._facts.update({name: str(value) for name, value in facts.items()})
            self._facts = {name: value for name, value in self._facts.items() if facts.get(name, value) is not None}

    def connect(self, publishers: Mapping[str, int], listeners: Mapping[str, int]) -> None:
        """Set who is at the other end: publishers found of each topic read, subscribers found of each published."""
        ends = {f"publishers {topic}": str(number) for topic, number in publishers.items()}
        with self._lock:
            self._ends = ends | {f"listeners {topic}": str(number) for topic, number in listeners.items()}

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

    def found(self, key: str, findings: Sequence[Finding]) -> None:
        """Set what stands now: a problem under `key` for people, a code each for programs."""
        with self._lock:
            self._findings[key] = tuple(findings)
        self.problem(key, "; ".join(map(str, findings)) or None)

    @property
    def drops(self) -> dict[str, int]:
        """Frames given up since the start, by reason."""
        with self._lock:
            return dict(self._drops)

    def forget(self) -> None:
        """Forget what is known of frames and standing problems; numbers of drops stay."""
        with self._lock:
            for known in (self._facts, self._problems, self._findings, self._recent, self._ticks, self._now):
                known.clear()

    def tick(
        self, name: str, state: str = "active", note: str = "", trouble: str = "", *, busy: bool = False
    ) -> DiagnosticStatus:
        """Close the current second and describe everything.

        Parameters
        ----------
        name : str
            Of the status, e.g. ``/disparity_node``.
        state : str
            Of the lifecycle.
        note : str
            The message where all is well; by default ``working`` or ``idle``.
        trouble : str
            An error worse than any frame's; shown under ``transition``.
        busy : bool
            Whether something waits or is being worked on.
        """
        with self._lock:
            self._busy_at = time.monotonic() if busy else self._busy_at
            idle = {IDLE: f"{time.monotonic() - self._busy_at:.1f}"}
            now, self._now = self._now, Counter()
            self._ticks.append(now)
            level, message = (ERROR, trouble) if trouble else self._verdict(now)
            told = (
                idle,
                self._facts,
                self._ends,
                self._rates(),
                self._spreads(),
                self._dropped(),
                self._problems,
                self._codes(),
            )
            values = {key: value for part in told for key, value in part.items()}
        if trouble:
            values["transition"] = trouble
        if level == OK:
            message = note or message
        if state != "active":
            message = state if message == "idle" else f"{state}: {message}"
        pairs = [KeyValue(key=key, value=value) for key, value in {"state": state, **values}.items()]
        return DiagnosticStatus(level=level, name=name, message=message, values=pairs)

    def _verdict(self, now: Counter[str]) -> tuple[bytes, str]:
        if now["failed"] and not now["done"]:  # inputs that are missing explain drops, not the other way round
            return ERROR, "; ".join(filter(None, (self._problems.get("silent"), self._last_fault)))
        if self._problems:
            return WARN, "; ".join(self._problems.values())
        if now["failed"]:
            return WARN, self._last_fault
        return OK, "working" if any(tick["done"] for tick in self._ticks) else "idle"

    @property
    def _last_fault(self) -> str:
        return self._last_drop or self._last_reason

    def _rates(self) -> dict[str, str]:
        seconds = len(self._ticks)
        sums: Counter[str] = Counter()
        for tick in self._ticks:
            sums.update(tick)
        sums["dropped"] = sums.pop("failed", 0) + sums.pop("skipped", 0)
        return {f"{name} [Hz]": f"{number / seconds:.2f}" for name, number in sorted(sums.items())}

    def _spreads(self) -> dict[str, str]:
        spreads = {}
        for what, values in self._recent.items():
            ordered = sorted(values)
            spreads[f"{what} [s]"] = f"{statistics.median(ordered):.4g}"
            spreads[f"{what} p95 [s]"] = f"{ordered[math.ceil(0.95 * len(ordered)) - 1]:.4g}"
            spreads[f"{what} max [s]"] = f"{ordered[-1]:.4g}"
        return spreads

    def _codes(self) -> dict[str, str]:
        texts = {finding.code.value: finding.text for found in self._findings.values() for finding in found}
        return {**texts, "codes": ",".join(texts)} if texts else {}

    def _dropped(self) -> dict[str, str]:
        dropped = {f"dropped: {reason}": str(number) for reason, number in sorted(self._drops.items())}
        if self._last_drop:
            dropped["last drop"] = self._last_drop
        if self._last_code:
            dropped["last drop code"] = self._last_code
        return {"dropped": str(sum(self._drops.values())), **dropped}
