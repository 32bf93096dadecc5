"""Which effort holds a rate: a rule on measured times, without clock, threads or ROS.

Rate comes first: it begins with the least effort and climbs. What the next effort would take is foretold from the ratio
of the two, measured at the last change between them. That knowledge fades, so that what was too slow once is tried
again: soon where it nearly fitted, rarely where it was far off. A trial that fails costs one late frame.

Where the next effort does not fit into every frame it may have every n-th: time that frames leave over is saved for it.
The rate is held in the mean; the frame itself is late.
"""

from __future__ import annotations

import statistics
from collections import deque
from collections.abc import Sequence

#: How many times longer the next effort takes, until measured: as ``test/benchmark/matching.py`` finds, roughly.
_STEP = 5.0
_WINDOW = 3  # frames whose median is believed: one late frame is an accident
_CALM = 10  # frames at an effort before the next is tried
_MARGIN = 0.8  # of the time there is, which the next effort must promise to keep
_HALF_LIFE = 500.0  # frames in which half of what was measured is forgotten


class EffortGovernor:
    """Picks one of several efforts, frame by frame, to hold a rate.

    Parameters
    ----------
    efforts : sequence of str
        From the least to the most that may be spent.
    period_s : float
        Time there is for a frame, s: one over the rate.
    better_every : int
        Frames at least from one at the next effort to the following; 0: none.

    Attributes
    ----------
    missed : bool
        Whether even the least effort takes longer.
    """

    def __init__(self, efforts: Sequence[str], period_s: float, better_every: int = 0) -> None:
        if not efforts or not period_s > 0:
            raise ValueError(f"expected efforts and a positive period, got {tuple(efforts)} and {period_s!r} s")
        self._efforts, self._period_s = tuple(efforts), period_s
        self._ratios = [_STEP] * (len(self._efforts) - 1)
        self._level = 0
        self._recent: deque[float] = deque(maxlen=_WINDOW)
        self._others: deque[float] = deque(maxlen=_WINDOW)
        self._frames = 0
        self._before: tuple[int, float] | None = None
        self._better_every, self._better = better_every, False
        self._since_better, self._saved_s = 0, 0.0
        self.missed = False

    @property
    def effort(self) -> str:
        """What to spend on the next frame."""
        return self._efforts[self._level + self._better]

    def record(self, took_s: float, others_s: float = 0.0) -> None:
        """Note how long a frame took; this may change the effort.

        Parameters
        ----------
        took_s : float
            At the present effort, s.
        others_s : float
            What had to be done besides, s, whatever the effort.
        """
        if self._better:
            self._had_better(took_s)
            return
        self._since_better += 1
        self._recent.append(took_s)
        self._others.append(others_s)
        self._frames += 1
        now_s = statistics.median(self._recent)
        budget_s = self._period_s - statistics.median(self._others)
        self._compare(now_s)
        on_trial = self._before is not None and self._before[0] < self._level
        late = now_s > budget_s and (on_trial or len(self._recent) == _WINDOW)
        self.missed = self._level == 0 and (late or (self.missed and now_s > budget_s))
        if late and self._level > 0:
            self._change(-1, now_s)
        elif not late and self._level < len(self._ratios):
            self._consider(now_s, budget_s)
        if self._frames == _WINDOW:
            self._before = None
        self._save(took_s, now_s, budget_s)

    def _save(self, took_s: float, now_s: float, budget_s: float) -> None:
        """Put aside what a frame left over; spend it once it is enough for a frame at the next effort."""
        if not self._better_every or self._level == len(self._ratios) or len(self._recent) < _WINDOW:
            return
        more_s = now_s * self._ratios[self._level] - _MARGIN * budget_s
        self._saved_s = min(max(0.0, self._saved_s + _MARGIN * budget_s - took_s), max(0.0, more_s))
        self._better = self._since_better + 1 >= self._better_every and self._saved_s >= more_s

    def _had_better(self, took_s: float) -> None:
        """Learn from a frame at the next effort what one takes."""
        self._ratios[self._level] = max(1.0, took_s / max(statistics.median(self._recent), 1e-9))
        self._better, self._since_better, self._saved_s = False, 0, 0.0

    def _compare(self, now_s: float) -> None:
        """Measure the ratio of the efforts on both sides of the last change, while it is fresh."""
        if self._before is not None:
            level, before_s = self._before
            low, high = (before_s, now_s) if level < self._level else (now_s, before_s)
            self._ratios[min(level, self._level)] = max(1.0, high / max(low, 1e-9))

    def _consider(self, now_s: float, budget_s: float) -> None:
        """Climb where the next effort promises to fit."""
        self._ratios[self._level] = max(1.0, self._ratios[self._level] * 0.5 ** (1 / _HALF_LIFE))
        if self._frames >= _CALM and now_s * self._ratios[self._level] < _MARGIN * budget_s:
            self._change(+1, now_s)

    def _change(self, step: int, now_s: float) -> None:
        self._before = (self._level, now_s)
        self._level += step
        self._frames, self._since_better, self._saved_s, self._better = 0, 0, 0.0, False
        self._recent.clear()
