"""Managed nodes that say what went wrong in a transition, and that no request can bring down.

rclpy swallows what a transition raises, and lets the error of one that is not possible escape into the executor.
"""

from __future__ import annotations

import traceback
from collections.abc import Callable
from typing import Any

from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

UNCONFIGURED, INACTIVE, ACTIVE, FINALIZED = "unconfigured", "inactive", "active", "finalized"


class ManagedNode(LifecycleNode):  # type: ignore[misc]
    """Base of managed nodes: the ROS 2 lifecycle, with four methods for a subclass to fill.

    What one of them raises is logged; then `deactivate` and `cleanup` bring the node back to unconfigured, from where
    it may be configured anew. All run in the executor's thread and must be brief.

    Parameters
    ----------
    name : str
    options
        Passed to ``rclpy.node.Node``.

    Attributes
    ----------
    trouble : str
        Why the last transition failed; empty where it did not.
    """

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        self.trouble = ""
        self._answer_change_state = self._service_change_state.callback
        self._service_change_state.callback = self._on_change_state

    @property
    def state(self) -> str:
        """Label of the current state, e.g. ``active``."""
        return str(self._state_machine.current_state[1])

    def destroy_node(self) -> None:
        """Leave the graph: rclpy forgets the state machine, which would keep node and services visible."""
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()

    def configure(self) -> None:
        """Make everything that is needed to be active."""

    def activate(self) -> None:
        """Begin to work."""

    def deactivate(self) -> None:
        """Stop working. Called in any state; raises nothing."""

    def cleanup(self) -> None:
        """Free what `configure` made, whole or in part. Called in any state, after `deactivate`; raises nothing."""

    def autostart(self) -> None:
        """Configure and activate."""
        if self.trigger_configure() == TransitionCallbackReturn.SUCCESS:
            self.trigger_activate()

    def finalize(self) -> None:
        """Shut down from whatever state."""
        if self.state in (UNCONFIGURED, INACTIVE, ACTIVE):
            self.trigger_shutdown()

    def on_configure(self, before: LifecycleState) -> TransitionCallbackReturn:
        """Answer the transition of this name."""
        return self._attempt("configure", self.configure)

    def on_activate(self, before: LifecycleState) -> TransitionCallbackReturn:
        """Answer the transition of this name."""
        return self._attempt("activate", self.activate)

    def on_deactivate(self, before: LifecycleState) -> TransitionCallbackReturn:
        """Answer the transition of this name."""
        return self._attempt("deactivate", self.deactivate)

    def on_cleanup(self, before: LifecycleState) -> TransitionCallbackReturn:
        """Answer the transition of this name."""
        return self._attempt("cleanup", self.cleanup)

    def on_shutdown(self, before: LifecycleState) -> TransitionCallbackReturn:
        """Answer the transition of this name."""
        return self._attempt("shutdown", self.deactivate, self.cleanup)

    def on_error(self, before: LifecycleState) -> TransitionCallbackReturn:
        """Clean up after a transition that failed, and be unconfigured."""
        self.deactivate()
        self.cleanup()
        return TransitionCallbackReturn.SUCCESS

    def _attempt(self, transition: str, *actions: Callable[[], None]) -> TransitionCallbackReturn:
        try:
            for action in actions:
                action()
        except Exception as error:  # whatever it is, the node must live to tell
            details = "" if isinstance(error, ValueError) else f"\n{traceback.format_exc()}"
            self.trouble = f"{transition} failed: {error}"
            self.get_logger().error(self.trouble + details)
            return TransitionCallbackReturn.ERROR
        self.trouble = ""
        return TransitionCallbackReturn.SUCCESS

    def _on_change_state(self, request: Any, response: Any) -> Any:
        try:
            return self._answer_change_state(request, response)
        except RuntimeError:  # RCLError: the state machine knows no such way
            asked = request.transition.label or f"transition {request.transition.id}"
            self.get_logger().warning(f"{asked} refused: expected one that leads out of {self.state}")
            response.success = False
            return response
