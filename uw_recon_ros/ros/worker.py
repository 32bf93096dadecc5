"""One thread for the heavy work, with a mailbox of one letter: the newest wins.

The executor's thread only receives, pairs and answers services; numpy, OpenCV and compiled kernels release the
interpreter while the worker is in them.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Generic, TypeVar

T = TypeVar("T")


class Mailbox(Generic[T]):
    """Room for one item; a newer one takes the place of one not fetched yet."""

    def __init__(self) -> None:
        self._condition = threading.Condition()
        self._item: T | None = None
        self._closed = False
        self._fetched = False

    @property
    def busy(self) -> bool:
        """Whether an item waits, or whoever fetched the last one has not asked for another yet."""
        with self._condition:
            return self._item is not None or self._fetched

    def put(self, item: T) -> bool:
        """Leave an item; return whether an older one had to go."""
        with self._condition:
            replaced = self._item is not None
            self._item = item
            self._condition.notify()
            return replaced

    def get(self) -> T | None:
        """Wait for an item and take it; None once the box is closed."""
        with self._condition:
            self._fetched = False
            while self._item is None and not self._closed:
                self._condition.wait()
            item, self._item = self._item, None
            self._fetched = not self._closed
            return None if self._closed else item

    def clear(self) -> bool:
        """Throw away what waits; return whether something did."""
        with self._condition:
            had, self._item = self._item is not None, None
            return had

    def close(self) -> None:
        """Wake and dismiss whoever waits."""
        with self._condition:
            self._closed = True
            self._condition.notify_all()


class Worker(Generic[T]):
    """A thread that works on the newest item.

    Parameters
    ----------
    name : str
    work : callable
        Called in the thread with each item; must not raise.
    begin : callable
        Called in the thread before anything else; must not raise.
    """

    def __init__(self, name: str, work: Callable[[T], None], begin: Callable[[], None] = lambda: None) -> None:
        self.mailbox: Mailbox[T] = Mailbox()
        self._work, self._begin = work, begin
        # A daemon, lest a long computation keep the process from ending.
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def stop(self, timeout_s: float) -> bool:
        """Finish; return whether the thread ended within `timeout_s`."""
        self.mailbox.close()
        self._thread.join(timeout_s)
        return not self._thread.is_alive()

    def _run(self) -> None:
        self._begin()
        while (item := self.mailbox.get()) is not None:
            self._work(item)
