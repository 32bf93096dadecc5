"""When a graph has nothing left to do: seen on ``/diagnostics``."""

from __future__ import annotations

import time
from collections.abc import Callable

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.node import Node

from uw_recon_ros.ros.diagnostics import IDLE
from uw_recon_ros.ros.qos import profile

#: So long every node must have been idle, s: longer than a message takes from one to the next.
_REST_S = 3.0
#: Reports come once a second: in so many seconds everybody who is there has been heard.
_HEARD_S = 5.0


class Drain:
    """Follows the stage nodes of a name space.

    Parameters
    ----------
    node : Node
        Whose name space it is; the subscription is this node's.
    """

    def __init__(self, node: Node) -> None:
        space = node.get_namespace()
        self._space = space if space.endswith("/") else f"{space}/"
        self._idle_s: dict[str, float] = {}
        self._subscription = node.create_subscription(DiagnosticArray, "/diagnostics", self._note, profile(depth=100))

    def wait(self, limit_s: float, spin: Callable[[], None]) -> str | None:
        """Spin until every node that reports has been idle for a while.

        Returns
        -------
        str or None
            Why it was given up: who is still at work after `limit_s`, or that nobody reports.
        """
        self._idle_s = dict.fromkeys(self._idle_s, 0.0)  # everybody known has to say so anew
        began = time.monotonic()
        while (waited_s := time.monotonic() - began) < limit_s:
            spin()
            if waited_s < _HEARD_S:
                continue
            if self._idle_s and min(self._idle_s.values()) >= _REST_S:
                return None
            if not self._idle_s:
                return f"no stage node reports on /diagnostics under {self._space}: nothing to wait for"
        at_work = [name for name, idle_s in self._idle_s.items() if idle_s < _REST_S]
        return f"still at work after {limit_s:g} s: {', '.join(sorted(at_work)) or 'nobody was heard'}"

    def _note(self, message: DiagnosticArray) -> None:
        for status in message.status:
            idle = next((pair.value for pair in status.values if pair.key == IDLE), None)
            if idle is not None and status.name.startswith(self._space):
                self._idle_s[status.name] = float(idle)
