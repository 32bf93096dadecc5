"""Messages of several streams in the order of time, each stream opened only when its turn comes."""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator

from uw_recon_ros.bags.model import RawMessage

#: Earliest time in the stream, ns, and how to start reading it.
LateStream = tuple[int, Callable[[], Iterator[RawMessage]]]


def merge_by_time(streams: Iterable[LateStream]) -> Iterator[RawMessage]:
    """Merge streams that are each in order of log time.

    Sources wait unopened until the merged stream reaches their first moment, so only those that overlap are held in
    memory: a chunk or a few, however long the bag. Equal times keep the order of the streams.

    Parameters
    ----------
    streams : iterable of (start_ns, open)

    Yields
    ------
    RawMessage
    """
    waiting: list[tuple[int, int, Iterator[RawMessage] | None, RawMessage | None]] = []
    openers: list[Callable[[], Iterator[RawMessage]]] = []
    for serial, (start_ns, opener) in enumerate(streams):
        openers.append(opener)
        waiting.append((start_ns, serial, None, None))
    heapq.heapify(waiting)
    while waiting:
        _, serial, stream, message = heapq.heappop(waiting)
        if stream is None:
            stream = openers[serial]()
        if message is not None:
            yield message
        following = next(stream, None)
        if following is not None:
            heapq.heappush(waiting, (following.log_ns, serial, stream, following))
