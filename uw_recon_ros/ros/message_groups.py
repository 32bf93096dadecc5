"""Which messages make up one piece of work: names, stamps, and anything for messages."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from uw_recon_ros.pairing import Synchronizer
from uw_recon_ros.ros.diagnostics import NO_PARTNER

#: Messages by input name; an input that has nothing is left out.
Group = dict[str, Any]

_DEPTH = 16


class Assembler:
    """Groups messages by stamp and adds the latest of those that are not paired.

    Parameters
    ----------
    deliver : callable
        Called with each complete group.
    drop : callable
        Called with a reason and a number of messages or groups given up.

    Attributes
    ----------
    tolerance_ns : int
        Largest difference of stamps within a group.
    memory_bytes : int
        What the waiting messages of one stream may take, beyond a few that always may.
    latest : dict
        The newest message of each input that is not paired.
    """

    def __init__(self, deliver: Callable[[Group], None], drop: Callable[[str, int], None]) -> None:
        self._deliver, self._drop = deliver, drop
        self.tolerance_ns = 0
        self.memory_bytes = 0
        self._streams: tuple[str, ...] = ()
        self._required_latest: frozenset[str] = frozenset()
        self.latest: Group = {}
        self._pending: Group | None = None
        self._largest = 1
        self._synchronizer: Synchronizer[Any] = Synchronizer(0)

    def expect(self, streams: Iterable[str], latest: Iterable[str]) -> None:
        """Say of which inputs a group consists.

        Parameters
        ----------
        streams : iterable of str
            Paired by stamp, all of them.
        latest : iterable of str
            Whose latest message goes along; a group waits until there is one.
        """
        self._required_latest = frozenset(latest)
        if tuple(streams := tuple(streams)) != self._streams or self._synchronizer.tolerance_ns != self.tolerance_ns:
            waiting = dict(zip(self._streams, self._synchronizer.waiting, strict=False))
            self._streams, self._pending, self._largest = streams, None, 1
            self._synchronizer = Synchronizer(len(streams), self.tolerance_ns, _DEPTH)
            self._again(waiting)
        self._release()

    def reset(self) -> None:
        """Forget everything received."""
        self._streams, self._pending = (), None
        self.latest.clear()

    @property
    def awaited(self) -> frozenset[str]:
        """Inputs whose latest message a complete group is waiting for."""
        return self._required_latest - self.latest.keys() if self._pending is not None else frozenset()

    def push(self, name: str, stamp_ns: int, message: Any, size: int = 0) -> None:
        """Take a message of a paired input.

        Parameters
        ----------
        name : str
        stamp_ns : int
        message : object
        size : int
            Bytes, for the memory limit.
        """
        if name not in self._streams:
            return
        self._largest = max(self._largest, size)
        self._synchronizer.depth = max(_DEPTH, self.memory_bytes // self._largest)
        before = self._synchronizer.dropped
        for group in self._synchronizer.push(self._streams.index(name), stamp_ns, message):
            self._complete(dict(zip(self._streams, group, strict=True)))
        if self._synchronizer.dropped > before:
            self._drop(NO_PARTNER, self._synchronizer.dropped - before)

    def _again(self, waiting: Mapping[str, Iterable[tuple[int, Any]]]) -> None:
        """Take what waited for partners of other streams: who comes late to the graph costs nobody a frame."""
        again = [(stamp, name, message) for name, items in waiting.items() for stamp, message in items]
        for stamp, name, message in sorted(again, key=lambda item: item[0]):
            self.push(name, stamp, message)

    def set_latest(self, name: str, message: Any) -> None:
        """Take a message of an input that is not paired."""
        self.latest[name] = message
        self._release()

    def _complete(self, group: Group) -> None:
        if self._pending is not None:
            self._drop(f"no {', '.join(sorted(self.awaited))} yet", 1)
        self._pending = group
        self._release()

    def _release(self) -> None:
        if self._pending is not None and not self.awaited:
            group, self._pending = self._pending, None
            self._deliver({**self.latest, **group})
