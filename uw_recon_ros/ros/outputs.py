"""A node's publishers, and who listens to them: what nobody listens to is neither computed nor sent."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterable
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher

from uw_recon_ros.ros.declared_topics import Output
from uw_recon_ros.ros.diagnostics import Diagnostics
from uw_recon_ros.ros.qos import advertise


class Publishers:
    """The publishers of a node, there from configuration to clean-up. Of the executor's thread.

    Parameters
    ----------
    node : Node
    outputs : iterable of Output
    on_match : callable
        Called in the executor's thread when subscribers come or go.
    """

    def __init__(self, node: Node, outputs: Iterable[Output], on_match: Callable[[], None]) -> None:
        self._node = node
        self.by_topic: dict[str, Publisher] = {}
        self.quiet: set[str] = set()
        try:
            for wanted in outputs:
                if wanted.quiet:
                    self.quiet.add(wanted.topic)
                self.by_topic[wanted.topic] = advertise(
                    node, wanted.type, wanted.topic, latched=wanted.latched, on_match=on_match
                )
        except Exception:
            self.destroy()
            raise

    def destroy(self) -> None:
        """Take the topics back."""
        while self.by_topic:
            self._node.destroy_publisher(self.by_topic.popitem()[1])


class Outputs:
    """The right to publish, from one activation to its end. All methods may be called from any thread.

    A frame holds on to the outputs under which its work began: what is finished later than these are closed is not
    sent, even if the node has been activated again meanwhile.

    Parameters
    ----------
    publishers : Publishers
    diagnostics : Diagnostics
        Counts what is sent.
    """

    def __init__(self, publishers: Publishers, diagnostics: Diagnostics) -> None:
        self._publishers, self._diagnostics = dict(publishers.by_topic), diagnostics
        self._quiet, self._told = frozenset(publishers.quiet), dict[str, Any]()
        self._lock = threading.Lock()
        self._open = True

    @property
    def open(self) -> bool:
        """Whether anything may be sent still."""
        return self._open

    def close(self) -> None:
        """Send nothing more; a message that is on its way out is waited for."""
        with self._lock:
            self._open = False

    def wanted(self, *topics: str) -> bool:
        """Whether anybody listens to one of `topics`, or to anything when none are named."""
        with self._lock:
            return self._open and any(
                self._publishers[topic].get_subscription_count() > 0
                for topic in topics or self._publishers
                if topic not in self._quiet
            )

    def listeners(self) -> dict[str, int]:
        """How many subscribers each topic's publisher has found: what it sends now reaches these."""
        return {topic: publisher.get_subscription_count() for topic, publisher in self._publishers.items()}

    def send(self, topic: str, make: Callable[[], Any]) -> None:
        """Publish the message that `make` returns, if anybody listens to `topic`."""
        if not self.wanted(topic):
            return
        message = make()
        with self._lock:
            if self._open:
                self._publishers[topic].publish(message)
                self._diagnostics.count(f"out {topic}")

    def tell(self, topic: str, value: Any, make: Callable[[], Any]) -> None:
        """Publish the message that `make` returns, listened to or not, if the node has `topic` and `value` is news."""
        with self._lock:
            if self._open and topic in self._publishers and self._told.get(topic) != value:
                self._publishers[topic].publish(make())
                self._told[topic] = value
                self._diagnostics.count(f"out {topic}")
