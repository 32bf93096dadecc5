"""What a bag holds, without the library that reads it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol

import yaml


@dataclass(frozen=True)
class RawMessage:
    """One recorded message, not decoded.

    Parameters
    ----------
    topic : str
        As recorded, e.g. ``/left/image_raw``.
    type : str
        E.g. ``sensor_msgs/msg/Image``.
    stamp_ns : int
        When it was recorded (log time), ns.
    data : bytes
        CDR, encapsulation header included: what a serialised publisher takes.
    """

    topic: str
    type: str
    stamp_ns: int
    data: bytes


@dataclass(frozen=True)
class QosProfile:
    """How a topic was offered when it was recorded; what the bag leaves open is ROS's default.

    Parameters
    ----------
    history : {'keep_last', 'keep_all'}
    depth : int
    reliability : {'reliable', 'best_effort'}
    durability : {'volatile', 'transient_local'}
    """

    history: str = "keep_last"
    depth: int = 10
    reliability: str = "reliable"
    durability: str = "volatile"


@dataclass(frozen=True)
class TopicInfo:
    """One topic of a bag.

    Parameters
    ----------
    name, type : str
    count : int
        Messages, as far as the bag knows: damage may cost some.
    qos : tuple of QosProfile
        Of every publisher that was recorded; empty when the bag does not say.
    """

    name: str
    type: str
    count: int
    qos: tuple[QosProfile, ...] = ()


class Storage(Protocol):
    """One file of a bag, opened."""

    damage: list[str]

    @property
    def topics(self) -> list[TopicInfo]:
        """What is in the file."""

    @property
    def span(self) -> tuple[int, int] | None:
        """First and last log time, ns; None when it holds no message."""

    def messages(self, topics: frozenset[str] | None, between: tuple[int, int] | None = None) -> Iterator[RawMessage]:
        """In log-time order; None = all topics, all times. `between`: first and last log time, ns, inclusive."""

    def close(self) -> None:
        """Release the file."""


# rmw's numbers (metadata up to version 8) and names (version 9)
_QOS_NAMES: dict[str, dict[Any, str]] = {
    "history": {1: "keep_last", 2: "keep_all"},
    "reliability": {1: "reliable", 2: "best_effort"},
    "durability": {1: "transient_local", 2: "volatile"},
}


def parse_qos(recorded: Any) -> tuple[QosProfile, ...]:
    """Read the ``offered_qos_profiles`` of a bag: YAML text or a list, with numbers or names; rubbish gives none."""
    try:
        entries = yaml.safe_load(recorded) if isinstance(recorded, str) else recorded
    except yaml.YAMLError:
        return ()
    return tuple(_profile(entry) for entry in entries or () if isinstance(entry, dict))


def _profile(entry: dict[str, Any]) -> QosProfile:
    known: dict[str, Any] = {}
    for field, names in _QOS_NAMES.items():
        value = entry.get(field)
        name = names.get(value) if isinstance(value, int) else value
        if name in names.values():
            known[field] = name
    depth = entry.get("depth")
    if isinstance(depth, int) and depth > 0:
        known["depth"] = depth
    return QosProfile(**known)


def merge_topics(groups: list[list[TopicInfo]]) -> list[TopicInfo]:
    """Add up the topics of several files, in order of first appearance."""
    merged: dict[tuple[str, str], TopicInfo] = {}
    for topic in (topic for group in groups for topic in group):
        before = merged.get((topic.name, topic.type), TopicInfo(topic.name, topic.type, 0))
        qos = before.qos + tuple(profile for profile in topic.qos if profile not in before.qos)
        merged[topic.name, topic.type] = TopicInfo(topic.name, topic.type, before.count + topic.count, qos)
    return list(merged.values())
