"""Which messages belong together: by stamp, exactly or within a tolerance. Nodes and offline readers share this."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Generic, TypeVar

T = TypeVar("T")


def align(stamps: Sequence[Sequence[int]], tolerance_ns: int = 0) -> tuple[list[tuple[int, ...]], tuple[int, ...]]:
    """Group the items of several streams by stamp.

    The heads of all streams form a group when their stamps lie within `tolerance_ns`; else the oldest head can have no
    partner any more and is passed over. The decision needs the heads alone, so a stream that arrives piecemeal is
    grouped exactly as one that is there at once.

    Parameters
    ----------
    stamps : sequence of sequences of int
        Non-decreasing stamps of each stream, ns.
    tolerance_ns : int
        Largest difference within a group, ns.

    Returns
    -------
    groups : list of tuple of int
        An index into each stream.
    consumed : tuple of int
        How many items of each stream are decided, grouped or passed over.
    """
    if tolerance_ns < 0:
        raise ValueError(f"tolerance_ns: expected >= 0, got {tolerance_ns}")
    heads = [0] * len(stamps)
    groups: list[tuple[int, ...]] = []
    while all(head < len(stream) for head, stream in zip(heads, stamps, strict=True)):
        now = [stream[head] for head, stream in zip(heads, stamps, strict=True)]
        if max(now) - min(now) <= tolerance_ns:
            groups.append(tuple(heads))
            heads = [head + 1 for head in heads]
        else:
            heads[now.index(min(now))] += 1
    return groups, tuple(heads)


@dataclass
class Synchronizer(Generic[T]):
    """Collects items of several streams as they arrive and hands out complete groups.

    Parameters
    ----------
    streams : int
        How many there are.
    tolerance_ns : int
        As in `align`.
    depth : int
        Items kept a stream while waiting for partners; the oldest goes first.

    Attributes
    ----------
    dropped : int
        Items that found no partner so far.
    """

    streams: int
    tolerance_ns: int = 0
    depth: int = 16
    dropped: int = 0
    _waiting: list[deque[tuple[int, T]]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._waiting = [deque() for _ in range(self.streams)]

    @property
    def waiting(self) -> list[list[tuple[int, T]]]:
        """Stamps and items of each stream that have no partners yet, oldest first."""
        return [list(queue) for queue in self._waiting]

    def push(self, stream: int, stamp_ns: int, item: T) -> list[tuple[T, ...]]:
        """Add an item; return the groups it completes (most often none or one).

        A stamp older than its predecessor on the same stream means that time was set back (a looped bag): whatever
        waits in any stream from after that moment is dropped.
        """
        queue = self._waiting[stream]
        if queue and stamp_ns < queue[-1][0]:
            self._forget_after(stamp_ns)
        queue.append((stamp_ns, item))
        if len(queue) > self.depth:
            queue.popleft()
            self.dropped += 1
        groups, consumed = align([[stamp for stamp, _ in q] for q in self._waiting], self.tolerance_ns)
        complete = [tuple(q[index][1] for q, index in zip(self._waiting, group, strict=True)) for group in groups]
        for q, count in zip(self._waiting, consumed, strict=True):
            for _ in range(count):
                q.popleft()
        self.dropped += sum(consumed) - len(groups) * self.streams
        return complete

    def _forget_after(self, stamp_ns: int) -> None:
        for queue in self._waiting:
            while queue and queue[-1][0] > stamp_ns + self.tolerance_ns:
                queue.pop()
                self.dropped += 1
