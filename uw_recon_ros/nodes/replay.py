"""What the bag player is told, what it offers, and what it says at the end."""

from __future__ import annotations

import argparse
import math
import statistics
import sys
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence

from rclpy.exceptions import NameValidationException
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.utilities import remove_ros_args

from uw_recon_ros.bags.model import TopicInfo
from uw_recon_ros.bags.reader import BagReader
from uw_recon_ros.errors import BagError
from uw_recon_ros.ros.message_types import message_class

_POLL_S = 0.05
_LARGEST = 1e6
_MOST_LATCHED = 1000
_MOST_TOPICS = 1000
_RECENT = 10_000
_REMIND_S = 10.0
_MOST_NAMED = 8


def parse(args: Sequence[str] | None, about: str | None) -> argparse.Namespace:
    """Read the command line, ROS arguments set aside; `about` is what ``--help`` says."""
    parser = argparse.ArgumentParser(
        prog="bag_player_node", description=about, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("bag", help="rosbag2 folder, or .mcap file")
    parser.add_argument("--rate", type=_positive, default=1.0, help="recorded seconds a second (default 1)")
    parser.add_argument("--loop", action="store_true", help="begin again at the end, until interrupted")
    parser.add_argument("--start-offset", type=_not_negative, default=0.0, metavar="S", help="skip the first S seconds")
    parser.add_argument("--start-paused", action="store_true", help="wait for ~/resume or ~/step")
    parser.add_argument("--topics", nargs="+", metavar="TOPIC", help="play only these")
    parser.add_argument(
        "--wait-for-subscribers", action="store_true", help="begin when any topic has one and no more came for a second"
    )
    parser.add_argument("--wait-for", nargs="+", metavar="TOPIC", help="begin when all of these have subscribers")
    parser.add_argument(
        "--wait-limit",
        type=_not_negative,
        default=0.0,
        metavar="S",
        help="begin anyway after S seconds (0: wait for ever)",
    )
    parser.add_argument(
        "--drain-limit", type=_not_negative, default=0.0, metavar="S",
        help="after the bag wait, at most S seconds, until the nodes have nothing left to do (default 0)",
    )  # fmt: skip
    parser.add_argument("--clock-rate", type=_not_negative, default=50.0, metavar="HZ", help="of /clock; 0 = none")
    return parser.parse_args(remove_ros_args(sys.argv if args is None else ["", *args])[1:])


def _positive(text: str) -> float:
    value = _not_negative(text)
    if not value:
        raise argparse.ArgumentTypeError(f"expected a number above 0, got {text}")
    return value


def _not_negative(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 <= value < _LARGEST:
        raise argparse.ArgumentTypeError(f"expected a number from 0 to {_LARGEST:g}, got {text!r}")
    return value


def recorded_profile(topic: TopicInfo) -> QoSProfile:
    """Offer what the recorded publishers offered; where they differ or are unknown, what suits every subscriber."""
    reliable = not topic.qos or any(qos.reliability == "reliable" for qos in topic.qos)
    latched = bool(topic.qos) and all(qos.durability == "transient_local" for qos in topic.qos)
    depth = max([10, *(qos.depth for qos in topic.qos)])
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST,
        depth=max(depth, min(topic.count, _MOST_LATCHED)) if latched else depth,
        reliability=ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT,
        durability=DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE,
    )


def advertise_recorded(node: Node, bag: BagReader, chosen: Sequence[str] | None) -> dict[str, Publisher]:
    """Make a publisher for every topic of a bag that can be played, relative to the node's name space.

    Raises
    ------
    BagError
        There is none.
    """
    publishers: dict[str, Publisher] = {}
    for topic in bag.topics:
        if (chosen and topic.name not in chosen) or topic.name == "/clock" or not topic.count:
            continue
        kind = message_class(topic.type)
        if kind is None:
            node.get_logger().warning(f"{topic.name}: skipped, no message package for {topic.type} is installed")
            continue
        if topic.name in publishers or len(publishers) == _MOST_TOPICS:
            reason = (
                "recorded with another type too" if topic.name in publishers else f"more than {_MOST_TOPICS} topics"
            )
            node.get_logger().warning(f"{topic.name} of {topic.type}: skipped, {reason}")
            continue
        options = QoSOverridingOptions.with_default_policies()
        try:
            publishers[topic.name] = node.create_publisher(
                kind, topic.name.lstrip("/"), recorded_profile(topic), qos_overriding_options=options
            )
        except (NameValidationException, ValueError) as error:
            node.get_logger().warning(f"{topic.name}: skipped, no name for a topic ({' '.join(str(error).split())})")
    if not publishers:
        names = ", ".join(topic.name for topic in bag.topics) or "none"
        raise BagError(f"{bag.path}: expected topics that can be played, the bag has {names}")
    return publishers


class Listeners:
    """Waits for subscribers, and says for which topics it does.

    Parameters
    ----------
    say : callable
        Called with a line when the waiting begins, once in a while, and when it is given up.
    spin : callable
        Spins so many seconds.
    limit_s : float
        The longest wait, s; 0: for ever.
    """

    def __init__(self, say: Callable[[str], None], spin: Callable[[float], None], limit_s: float) -> None:
        self._say, self._spin, self._limit_s = say, spin, limit_s

    def wait(self, publishers: Sequence[Publisher], enough: Callable[[list[int]], bool], settle_s: float) -> bool:
        """Spin until `enough` holds for the numbers of subscribers, and these have not changed for `settle_s`.

        Returns
        -------
        bool
            False where it was given up.
        """
        began = since = time.monotonic()
        told, counts = 0, list[int]()
        while not counts or not enough(counts) or time.monotonic() - since < settle_s:
            self._spin(_POLL_S)
            before, counts = counts, [publisher.get_subscription_count() for publisher in publishers]
            now = time.monotonic()
            since = since if counts == before else now
            missing = [p.topic_name for p, count in zip(publishers, counts, strict=True) if not count]
            if self._limit_s and now - began > self._limit_s and not enough(counts):
                self._say(f"no subscriber to {_some(missing)} in {self._limit_s:g} s: playing all the same")
                return False
            if now - began > told * _REMIND_S and not enough(counts):
                told += 1
                self._say(self._waiting(missing, "any" if enough is any else "all"))
        return True

    def _waiting(self, missing: Sequence[str], kind: str) -> str:
        limit = f"{self._limit_s:g} s at most" if self._limit_s else "without limit"
        return (
            f"waiting, {limit}, for a subscriber to {kind} of {_some(missing)}"
            " (nodes subscribe while somebody listens to what they publish, e.g. points2)"
        )


def _some(names: Sequence[str]) -> str:
    more = f" and {len(names) - _MOST_NAMED} more" if len(names) > _MOST_NAMED else ""
    return ", ".join(names[:_MOST_NAMED]) + more


class Tally:
    """What was sent, and how late."""

    def __init__(self) -> None:
        self._sent: Counter[str] = Counter()
        self._late: deque[float] = deque(maxlen=_RECENT)
        self._latest = 0.0

    def sent(self, topic: str) -> None:
        """Count a message."""
        self._sent[topic] += 1

    def late(self, seconds: float) -> None:
        """Note by how much a message missed its moment."""
        self._late.append(seconds)
        self._latest = max(self._latest, seconds)

    def line(self, took_s: float, rate: float) -> str:
        """Say it all in one line."""
        counts = ", ".join(f"{topic} {number}" for topic, number in self._sent.items()) or "nothing"
        median_ms = statistics.median(self._late or [0.0]) * 1e3
        return (
            f"sent {sum(self._sent.values())} messages in {took_s:.2f} s at rate {rate:g} ({counts}), "
            f"late by {median_ms:.1f} ms median, {self._latest * 1e3:.1f} ms at most"
        )
