"""How long each stage takes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field


@dataclass
class Stopwatch:
    """Wall time of each stage, s; what is timed inside another block is not counted twice.

    Parameters
    ----------
    announce : callable or None
        Told the name of each stage as it begins.
    """

    announce: Callable[[str], None] | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    _inside: list[float] = field(default_factory=list)

    @contextmanager
    def __call__(self, stage: str) -> Iterator[None]:
        """Time a block."""
        if self.announce is not None:
            self.announce(stage)
        started = time.perf_counter()
        self._inside.append(0.0)
        try:
            yield
        finally:
            elapsed, inner = time.perf_counter() - started, self._inside.pop()
            self.seconds[stage] = self.seconds.get(stage, 0.0) + elapsed - inner
            if self._inside:
                self._inside[-1] += elapsed
