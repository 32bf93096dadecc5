"""Why nothing comes: what ROS knows and does not say."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from rclpy.node import Node

from uw_recon_ros.topics import find_topic


def why_silent(node: Node, topic: str, alternatives: Sequence[str], *, required: bool) -> tuple[str, str] | None:
    """Explain why `topic` brings no messages.

    Parameters
    ----------
    node : Node
        With a subscription to it.
    topic : str
    alternatives : sequence of str
        Topics any of which would do.
    required : bool
        Whether the node can do without.

    Returns
    -------
    (str, str) or None
        What is waited for, and why it does not come. None: nobody publishes it, and nobody needs to.
    """
    resolved = node.resolve_topic_name(topic)
    publishers = node.get_publishers_info_by_topic(resolved)
    if publishers:
        return resolved, _disagreement(node, resolved, publishers) or "a publisher, but no messages"
    if not required:
        return None
    return " or ".join(node.resolve_topic_name(name) for name in alternatives), "no publisher"


def not_installed(topic: str) -> str:
    """What to do about a topic of the table whose messages nobody installed."""
    package = find_topic(topic).type.split("/")[0]
    distro = os.environ.get("ROS_DISTRO", "$ROS_DISTRO")
    return (
        f"a publisher, but {package} is not installed: apt install ros-{distro}-{package.replace('_', '-')}, or "
        "publish raw or compressed images"
    )


def in_one_line(reasons: Iterable[tuple[str, str]]) -> str | None:
    """Join what `why_silent` said of several topics, those of one reason together; None where it said nothing."""
    topics: dict[str, list[str]] = {}
    for topic, reason in reasons:
        topics.setdefault(reason, []).append(topic)
    return (
        "waiting for " + "; ".join(f"{', '.join(names)}: {reason}" for reason, names in topics.items())
        if topics
        else None
    )


def _disagreement(node: Node, topic: str, publishers: Sequence[Any]) -> str | None:
    """How a publisher's type differs from ours: then the middleware connects nothing and says nothing."""
    ours = [e for e in node.get_subscriptions_info_by_topic(topic) if e.node_name == node.get_name()]
    for theirs in publishers:
        for our in ours:
            if theirs.topic_type != our.topic_type:
                return f"expected {our.topic_type}, {theirs.node_name} publishes {theirs.topic_type}"
            hashes = [str(getattr(end, "topic_type_hash", "")) for end in (our, theirs)]
            if hashes[0] != hashes[1]:
                return f"{theirs.node_name} publishes another version of {our.topic_type} (type hashes differ)"
    return None


def why_unpaired(stamps: Mapping[str, int], tolerance_ns: int) -> str | None:
    """Explain why messages arrive and yet make no group.

    Parameters
    ----------
    stamps : mapping
        Topic to its last stamp, ns.
    tolerance_ns : int
    """
    if len(stamps) < 2:
        return None
    first, last = min(stamps, key=stamps.__getitem__), max(stamps, key=stamps.__getitem__)
    if stamps[last] - stamps[first] <= tolerance_ns:
        return None  # they do: what comes is only slow
    apart_ms = (stamps[last] - stamps[first]) / 1e6
    return f"no stamps pair up: {last} is {apart_ms:g} ms after {first}, pair_tolerance_ms is {tolerance_ns / 1e6:g}"
