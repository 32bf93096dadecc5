"""What a bag holds, without the library that reads it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Protocol

from uw_recon_ros.files import strict_yaml

#: Log times from here on are beyond what ROS's 32 bits of seconds can say.
LATEST_NS = 2**31 * 1_000_000_000
_LONGEST_NAME = 255
_LONGEST_NOTE = 500
_MOST_NOTES = 1000
LONGEST_QOS = 16_384  # characters; one publisher's take some 300
_MOST_PROFILES = 100  # of one topic's publishers
_DEEPEST = 1000  # messages; middleware makes room for them


def add_note(notes: list[str], sentence: str) -> None:
    """Add a sentence about damage: in one line of bounded length, none twice, no more than anyone reads."""
    line = " ".join(sentence.split())
    line = line if line.isprintable() else ascii(line)
    line = line if len(line) <= _LONGEST_NOTE else f"{line[:_LONGEST_NOTE]}..."
    if len(notes) < _MOST_NOTES and line not in notes:
        notes.append(line)
        if len(notes) == _MOST_NOTES:
            notes.append("more damage is not listed")


def is_name(text: Any) -> bool:
    """Whether a topic or a type may be called so."""
    return isinstance(text, str) and 0 < len(text) <= _LONGEST_NAME and text.isprintable()


def plain(text: Any) -> str:
    """Text out of a bag, fit for a terminal."""
    told = str(text)
    return told if is_name(told) or not told else ascii(told[:40])


@dataclass(frozen=True)
class RawMessage:
    """One recorded message, not decoded.

    Parameters
    ----------
    topic : str
        As recorded, e.g. ``/left/image_raw``.
    type : str
        E.g. ``sensor_msgs/msg/Image``.
    log_ns : int
        When it was recorded (log time), ns.
    data : bytes
        CDR, encapsulation header included: what a serialised publisher takes.
    """

    topic: str
    type: str
    log_ns: int
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
        entries = strict_yaml.load(recorded[:LONGEST_QOS]) if isinstance(recorded, str) else recorded
    except strict_yaml.YamlError:
        return ()
    return tuple(_profile(entry) for entry in entries if isinstance(entry, dict)) if isinstance(entries, list) else ()


def _profile(entry: dict[str, Any]) -> QosProfile:
    known: dict[str, Any] = {}
    for field, names in _QOS_NAMES.items():
        value = entry.get(field)
        name = names.get(value) if isinstance(value, int) else value
        if isinstance(name, str) and name in names.values():
            known[field] = name
    depth = entry.get("depth")
    if isinstance(depth, int) and depth > 0:
        known["depth"] = min(depth, _DEEPEST)
    return QosProfile(**known)


def merge_topics(groups: list[list[TopicInfo]]) -> list[TopicInfo]:
    """Add up the topics of several files, in order of first appearance."""
    merged: dict[tuple[str, str], TopicInfo] = {}
    for topic in (topic for group in groups for topic in group):
        before = merged.get((topic.name, topic.type), TopicInfo(topic.name, topic.type, 0))
        qos = tuple(dict.fromkeys((*before.qos, *topic.qos[:_MOST_PROFILES])))[:_MOST_PROFILES]
        merged[topic.name, topic.type] = TopicInfo(topic.name, topic.type, before.count + topic.count, qos)
    return list(merged.values())
