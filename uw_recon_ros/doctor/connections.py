"""Publishers and subscribers that the middleware does not connect, without a word: types, type hashes, QoS."""

from __future__ import annotations

from collections.abc import Iterator

from uw_recon_ros.doctor.check import Check, fail
from uw_recon_ros.doctor.observation import Endpoint, Observation, ObservedTopic
from uw_recon_ros.doctor.topic_graph import TYPES

_STAGE = "connections"


def disagreement(publisher: Endpoint, subscriber: Endpoint) -> tuple[str, str] | None:
    """Why two ends of a topic never meet, and what to do; None: they do."""
    ours, theirs = subscriber, publisher
    if theirs.type != ours.type:
        return (
            f"{theirs.node} publishes {theirs.type}, {ours.node} expects {ours.type}",
            f"remap one of them, or have {theirs.node} publish {ours.type}",
        )
    if theirs.type_hash and ours.type_hash and theirs.type_hash != ours.type_hash:
        return (
            f"{theirs.node} publishes another version of {ours.type} than {ours.node} expects (type hashes differ)",
            "run both with one ROS distribution",
        )
    if ours.reliable and not theirs.reliable:
        return (
            f"{theirs.node} offers best effort only, {ours.node} demands reliable",
            f"have {theirs.node} publish reliable, or take qos_overrides.*.reliability away from {ours.node}",
        )
    if ours.latched and not theirs.latched:
        return (
            f"{theirs.node} offers volatile durability, {ours.node} demands transient local",
            f"set {ours.node}'s durability to volatile",
        )
    return None


def _of_topic(topic: ObservedTopic) -> Iterator[Check]:
    for subscriber in topic.subscribers:
        for publisher in topic.publishers:
            reason = disagreement(publisher, subscriber)
            if reason:
                yield fail(_STAGE, f"{topic.name}: {reason[0]}", reason[1])


def _of_type(relative: str, topic: ObservedTopic) -> Iterator[Check]:
    """A wrong type is wrong before anybody subscribes."""
    for publisher in topic.publishers:
        if publisher.type != TYPES[relative] and not topic.subscribers:
            yield fail(
                _STAGE,
                f"{topic.name}: expected {TYPES[relative]}, {publisher.node} publishes {publisher.type}",
                f"remap {publisher.node}'s topic away, and the right one here",
            )


def check_connections(seen: Observation) -> list[Check]:
    """Look at both ends of every topic of the chain."""
    return [
        finding
        for relative, topic in seen.topics.items()
        for finding in (*_of_type(relative, topic), *_of_topic(topic))
    ]
