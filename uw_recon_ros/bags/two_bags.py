"""A rig whose cameras were recorded each into a bag of its own, read as one bag."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path

from uw_recon_ros.bags.merge import merge_by_time
from uw_recon_ros.bags.model import RawMessage, TopicInfo
from uw_recon_ros.bags.reader import BagReader
from uw_recon_ros.bags.stereo import StereoTopics, best_images, find_stereo_topics
from uw_recon_ros.errors import BagError

_SIDES = ("/left", "/right")


class TwoBags(BagReader):
    """The bag of the left camera and that of the right one. A topic of both gets the side in front of its name.

    Parameters
    ----------
    left, right : path

    Raises
    ------
    BagError
        One of them cannot be read.
    """

    def __init__(self, left: Path, right: Path) -> None:
        self.path = left
        with ExitStack() as opened:
            self._readers = [opened.enter_context(BagReader(path)) for path in (left, right)]
            self._opened = opened.pop_all()
        ours, theirs = ({topic.name for topic in reader.topics} for reader in self._readers)
        self._shared = ours & theirs
        self.topics = [
            TopicInfo(self._named(topic.name, side), topic.type, topic.count, topic.qos)
            for side, reader in enumerate(self._readers)
            for topic in reader.topics
        ]
        self.start_ns = min(reader.start_ns for reader in self._readers)
        self.end_ns = max(reader.end_ns for reader in self._readers)
        self.notes = []

    def _named(self, name: str, side: int) -> str:
        return f"{_SIDES[side]}{name}" if name in self._shared else name

    @property
    def damage(self) -> list[str]:
        """What could not be read of either."""
        return [*(sentence for reader in self._readers for sentence in reader.damage), *self.notes]

    def raw_messages(
        self, topics: Iterable[str] | None = None, between: tuple[int, int] | None = None
    ) -> Iterator[RawMessage]:
        """Messages of both in log-time order, as `BagReader.raw_messages`."""
        wanted = None if topics is None else frozenset(topics)
        return merge_by_time(
            (reader.start_ns, partial(self._messages, side, wanted, between))
            for side, reader in enumerate(self._readers)
        )

    def _messages(
        self, side: int, wanted: frozenset[str] | None, between: tuple[int, int] | None
    ) -> Iterator[RawMessage]:
        reader = self._readers[side]
        names = [t.name for t in reader.topics if wanted is None or self._named(t.name, side) in wanted]
        for raw in reader.raw_messages(names, between) if names else ():
            yield RawMessage(self._named(raw.topic, side), raw.type, raw.log_ns, raw.data)

    def stereo_topics(self, left: str | None = None, right: str | None = None) -> StereoTopics:
        """The cameras' topics: by their names, else the images of either bag."""
        with suppress(BagError):
            return find_stereo_topics(self.topics, left, right)
        count = len(self._readers[0].topics)
        halves = self.topics[:count], self.topics[count:]
        return find_stereo_topics(self.topics, left or best_images(halves[0]), right or best_images(halves[1]))

    def close(self) -> None:
        """Close both."""
        self._opened.close()
