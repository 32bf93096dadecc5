"""What a node answers when the doctor asks it: parameters, and its state where it is managed."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.parameter import parameter_value_to_python

try:
    from lifecycle_msgs.srv import GetState
except ImportError:  # a ROS without managed nodes
    GetState = None

_ASK_S = 1.0
_PARAMETERS = ("use_sim_time", "pair_tolerance_ms", "image_transport", "calibration_use")


class Asked:
    """What one of our nodes answers: parameters, and its state where it is managed."""

    def __init__(self, node: Node, name: str) -> None:
        self._node, self._name = node, name
        self.answers, self.managed, self.state = False, False, ""
        self.parameters: dict[str, Any] = {}
        self._clients: dict[str, Any] = {}
        self._asked_s = 0.0

    def ask(self, services: set[str]) -> None:
        """Ask again, now and then."""
        if time.monotonic() - self._asked_s < _ASK_S:
            return
        self._asked_s = time.monotonic()
        request = GetParameters.Request(names=list(_PARAMETERS))
        self._call("get_parameters", GetParameters, request, self._on_parameters)
        self.managed = GetState is not None and f"{self._name}/get_state" in services
        if self.managed:
            self._call("get_state", GetState, GetState.Request(), self._on_state)

    def _call(self, service: str, kind: Any, request: Any, done: Callable[[Any], None]) -> None:
        if service not in self._clients:
            self._clients[service] = self._node.create_client(kind, f"{self._name}/{service}")
        if self._clients[service].service_is_ready():
            self._clients[service].call_async(request).add_done_callback(lambda future: done(future.result()))

    def _on_parameters(self, answer: Any) -> None:
        self.answers = True
        values = [parameter_value_to_python(value) for value in answer.values]
        self.parameters = {n: v for n, v in zip(_PARAMETERS, values, strict=False) if v is not None}

    def _on_state(self, answer: Any) -> None:
        self.answers, self.state = True, answer.current_state.label
