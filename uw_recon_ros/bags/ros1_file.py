"""One ROS 1 bag: its images and calibrations as ROS 2's messages. Reading is rosbags', the bytes are made anew."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.rosbag1 import Reader, ReaderError
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from uw_recon_ros.bags import messages
from uw_recon_ros.bags.messages import CAMERA_INFO, COMPRESSED_IMAGE, IMAGE
from uw_recon_ros.bags.model import RawMessage, TopicInfo, add_note
from uw_recon_ros.errors import BagError

MAGIC = b"#ROSBAG V2"
_KNOWN = (IMAGE, COMPRESSED_IMAGE, CAMERA_INFO)


@cache
def _ros1() -> Typestore:
    return get_typestore(Stores.ROS1_NOETIC)


class Ros1File:
    """A ``.bag`` file as a `Storage`; topics of other types are listed, and not read."""

    def __init__(self, path: Path, name: str) -> None:
        self.damage: list[str] = []
        self._name = name
        try:
            self._reader = Reader(path)
            self._reader.open()
        except Exception as error:  # of a parser of strangers' bytes
            raise BagError(f"{path}: expected a ROS 1 bag with its index, got a damaged one: rosbag reindex") from error

    @property
    def topics(self) -> list[TopicInfo]:
        """What is in the file."""
        return [TopicInfo(c.topic, c.msgtype, c.msgcount) for c in self._reader.connections]

    @property
    def span(self) -> tuple[int, int] | None:
        """First and last log time, ns; None when it holds no message."""
        if not any(c.msgcount for c in self._reader.connections):
            return None
        return self._reader.start_time, self._reader.end_time

    def messages(self, topics: frozenset[str] | None, between: tuple[int, int] | None = None) -> Iterator[RawMessage]:
        """In log-time order; see `Storage`."""
        wanted = [c for c in self._reader.connections if c.msgtype in _KNOWN and (topics is None or c.topic in topics)]
        if not wanted:
            return
        start, stop = (None, None) if between is None else (between[0], between[1] + 1)
        try:
            for connection, time, data in self._reader.messages(wanted, start=start, stop=stop):
                try:
                    yield RawMessage(connection.topic, connection.msgtype, time, _as_ros2(data, connection.msgtype))
                except (SerdeError, KeyError, ValueError, AssertionError, IndexError, OverflowError) as error:
                    add_note(
                        self.damage, f"{connection.topic}: a message at {time} ns is no {connection.msgtype}: {error}"
                    )
        except (ReaderError, OSError, ValueError, AssertionError) as error:
            add_note(self.damage, f"{self._name}: damaged, what follows is lost: {error}")

    def close(self) -> None:
        """Release the file."""
        self._reader.close()


def _as_ros2(data: Any, kind: str) -> bytes:
    found = _ros1().deserialize_ros1(bytes(data), kind)
    return messages.encode(_moved(found, kind))[1]


def _moved(found: Any, kind: str) -> Any:
    """A ROS 1 message object as ROS 2's: names in small letters, headers without sequence numbers."""
    old = {name.lower(): getattr(found, name) for name in found.__dataclass_fields__ if not name.startswith("__")}
    fields: dict[str, Any] = {}
    for name, (node, inner) in messages.typestore().fielddefs[kind][1]:
        fields[name] = _moved(old[name], str(inner)) if node is Nodetype.NAME else old[name]
    return messages.MAKE(kind, **fields)
