"""What a node says without being asked: its diagnostics once a second, and in the log that it compiles."""

from __future__ import annotations

from typing import Any, Protocol

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType

from uw_recon_ros.ros.diagnostics import Diagnostics
from uw_recon_ros.ros.inputs import Inputs
from uw_recon_ros.ros.outputs import Outputs
from uw_recon_ros.ros.qos import profile
from uw_recon_ros.ros.session import NodeSession

_PERIOD_S = 1.0


class Reported(Protocol):
    """What is told of a node; a node has it all."""

    diagnostics: Diagnostics
    inputs: Inputs
    trouble: str

    @property
    def session(self) -> NodeSession[Any] | None:
        """Its session, while configured."""

    @property
    def state(self) -> str:
        """Of the lifecycle."""

    def say_unasked(self, outputs: Outputs) -> None:
        """Say what no frame tells."""


class Reporter:
    """Publishes a node's diagnostics in every state, whatever the node's clock does.

    Parameters
    ----------
    node : Reported and rclpy's Node
    """

    def __init__(self, node: Any) -> None:
        self._ros: Any = node
        self._node: Reported = node
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", profile())
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(_PERIOD_S, self._report, clock=steady)

    def _report(self) -> None:
        node, ros, session = self._node, self._ros, self._node.session
        warming, busy, listeners = False, False, dict[str, int]()
        if session is not None:
            busy = session.busy
            warming, listeners = session.warm_up.running, session.outputs.listeners()
            node.diagnostics.say(warm_up="running" if warming else "done")
            if (news := session.warm_up.news()) is not None:
                ros.get_logger().info(news)
            node.say_unasked(session.outputs)
        node.diagnostics.connect(node.inputs.publishers(), listeners)
        note = "warming up: compiling" if warming else ""
        status = node.diagnostics.tick(ros.get_fully_qualified_name(), node.state, note, node.trouble, busy=busy)
        message = DiagnosticArray(status=[status])
        message.header.stamp = ros.get_clock().now().to_msg()
        self._publisher.publish(message)
