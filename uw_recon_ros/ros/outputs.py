"""A node's publishers, and who listens to them: what nobody listens to is neither computed nor sent."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

from rclpy.node import Node

from uw_recon_ros.ros.diagnostics import Diagnostics
from uw_recon_ros.ros.qos import advertise
from uw_recon_ros.ros.topics import Output


class Outputs:
    """The publishers of a node.

    Parameters
    ----------
    node : Node
    outputs : iterable of Output
    diagnostics : Diagnostics
        Counts what is sent.
    on_match : callable
        Called in the executor's thread when subscribers come or go.
    """

    def __init__(
        self, node: Node, outputs: Iterable[Output], diagnostics: Diagnostics, on_match: Callable[[], None]
    ) -> None:
        self._diagnostics = diagnostics
        self._publishers = {
            output.topic: advertise(node, output.type, output.topic, latched=output.latched, on_match=on_match)
            for output in outputs
        }

    def wanted(self, *topics: str) -> bool:
        """Whether anybody listens to one of `topics`, or to anything when none are named."""
        publishers = [self._publishers[topic] for topic in topics] if topics else self._publishers.values()
        return any(publisher.get_subscription_count() > 0 for publisher in publishers)

    def send(self, topic: str, make: Callable[[], Any]) -> None:
        """Publish the message that `make` returns, if anybody listens to `topic`."""
        if self.wanted(topic):
            self._publishers[topic].publish(make())
            self._diagnostics.count(f"out {topic}")
