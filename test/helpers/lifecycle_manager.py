"""Drives managed nodes by their services, as Nav2's lifecycle manager does."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetAvailableTransitions, GetState
from rcl_interfaces.srv import SetParameters
from rclpy.node import Node
from rclpy.parameter import Parameter

from helpers.ros_bench import meet

CONFIGURE, CLEANUP = Transition.TRANSITION_CONFIGURE, Transition.TRANSITION_CLEANUP
ACTIVATE, DEACTIVATE = Transition.TRANSITION_ACTIVATE, Transition.TRANSITION_DEACTIVATE
SHUTDOWN = {
    "unconfigured": Transition.TRANSITION_UNCONFIGURED_SHUTDOWN,
    "inactive": Transition.TRANSITION_INACTIVE_SHUTDOWN,
    "active": Transition.TRANSITION_ACTIVE_SHUTDOWN,
}
WAY_TO = {"unconfigured": (), "inactive": (CONFIGURE,), "active": (CONFIGURE, ACTIVATE)}


class Manager:
    """Of one node."""

    def __init__(self, outsider: Node, name: str, spin_until: Callable[[Callable[[], Any], str], None]) -> None:
        self._spin_until = spin_until
        self._clients = {
            kind: outsider.create_client(kind, f"/{name}/{service}")
            for kind, service in (
                (ChangeState, "change_state"), (GetState, "get_state"), (SetParameters, "set_parameters"),
                (GetAvailableTransitions, "get_available_transitions"),
            )
        }  # fmt: skip
        meet(outsider, f"/{name}", spin_until)

    def call(self, request: Any, kind: Any) -> Any:
        client = self._clients[kind]
        self._spin_until(client.service_is_ready, kind.__name__)
        future = client.call_async(request)
        self._spin_until(future.done, kind.__name__)
        return future.result()

    def change(self, *transitions: int) -> bool:
        """Whether all of them succeeded."""
        return all(
            self.call(ChangeState.Request(transition=Transition(id=each)), ChangeState).success for each in transitions
        )

    @property
    def state(self) -> str:
        return str(self.call(GetState.Request(), GetState).current_state.label)

    def set(self, **values: Any) -> Any:
        parameters = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        return self.call(SetParameters.Request(parameters=parameters), SetParameters).results[0]
