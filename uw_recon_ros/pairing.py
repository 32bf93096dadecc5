"""Which messages belong together: by stamp, exactly or within a tolerance. Nodes and offline readers share this."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Generic, TypeVar

T = TypeVar("T")

#: Largest difference of stamps within a pair that every command and node allows unasked, ms.
PAIR_TOLERANCE_MS = 1.0


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

    Where time is set back (a looped bag) the streams begin another round, each in its own moment: what waited from
    after that moment is kept aside for partners that were under way still, since a stage that takes longer than a round
    would else never find any. Items of one stamp from different rounds may form a group then.

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
    _earlier: list[deque[tuple[int, T]]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        self._waiting = [deque() for _ in range(self.streams)]
        self._earlier = [deque() for _ in range(self.streams)]

    @property
    def waiting(self) -> list[list[tuple[int, T]]]:
        """Stamps and items of each stream that have no partners yet, oldest first."""
        return [list(queue) for queue in self._waiting]

    def push(self, stream: int, stamp_ns: int, item: T) -> list[tuple[T, ...]]:
        """Add an item; return the groups it completes (most often none or one)."""
        queue = self._waiting[stream]
        if queue and stamp_ns < queue[-1][0]:
            self._set_back(stamp_ns)
        if any(self._earlier) and self._belongs_to_earlier(stream, stamp_ns):
            self._keep_aside(stream, (stamp_ns, item))
            return self._late_groups(stamp_ns)
        queue.append((stamp_ns, item))
        self._trim(stream)
        complete = self._aligned()
        for _ in complete:
            self._fade()
        return complete

    def _aligned(self) -> list[tuple[T, ...]]:
        groups, consumed = align([[stamp for stamp, _ in q] for q in self._waiting], self.tolerance_ns)
        complete = [tuple(q[index][1] for q, index in zip(self._waiting, group, strict=True)) for group in groups]
        for q, count in zip(self._waiting, consumed, strict=True):
            for _ in range(count):
                q.popleft()
        self.dropped += sum(consumed) - len(groups) * self.streams
        return complete

    def _set_back(self, stamp_ns: int) -> None:
        for stream, queue in enumerate(self._waiting):
            later: list[tuple[int, T]] = []
            while queue and queue[-1][0] > stamp_ns + self.tolerance_ns:
                later.append(queue.pop())
            for entry in reversed(later):
                self._keep_aside(stream, entry)

    def _keep_aside(self, stream: int, entry: tuple[int, T]) -> None:
        """Keep an item of an earlier round, in place of one of the same stamp."""
        kept = self._earlier[stream]
        same = [e for e in kept if e[0] == entry[0]]
        for old in same:
            kept.remove(old)
        self.dropped += len(same)
        kept.append(entry)
        self._trim(stream)

    def _belongs_to_earlier(self, stream: int, stamp_ns: int) -> bool:
        """Whether an item's partners are among those kept aside, and none of them among those of this round."""
        others = [s for s in range(self.streams) if s != stream]
        return any(self._find(self._earlier[s], stamp_ns) is not None for s in others) and all(
            self._find(self._waiting[s], stamp_ns) is None for s in others
        )

    def _late_groups(self, stamp_ns: int) -> list[tuple[T, ...]]:
        """The group of this stamp among those kept aside, if it is complete."""
        found = [self._find(kept, stamp_ns) for kept in self._earlier]
        if any(index is None for index in found):
            return []
        group = []
        for kept, index in zip(self._earlier, found, strict=True):
            assert index is not None
            group.append(kept[index][1])
            del kept[index]
        return [tuple(group)]

    def _find(self, queue: deque[tuple[int, T]], stamp_ns: int) -> int | None:
        """Index of the item nearest in time, the newest of equal ones; None where none is within the tolerance."""
        best, distance = None, self.tolerance_ns
        for index, (stamp, _) in enumerate(queue):
            if abs(stamp - stamp_ns) <= distance:
                best, distance = index, abs(stamp - stamp_ns)
        return best

    def _trim(self, stream: int) -> None:
        earlier, waiting = self._earlier[stream], self._waiting[stream]
        while len(earlier) + len(waiting) > self.depth:
            (earlier or waiting).popleft()
            self.dropped += 1

    def _fade(self) -> None:
        """Let go of what is kept aside, little by little, while this round has its groups."""
        for kept in self._earlier:
            if kept:
                kept.popleft()
                self.dropped += 1
