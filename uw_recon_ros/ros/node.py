"""The stage node: inputs paired, the newest group worked on in a thread, outputs only for those who listen."""

from __future__ import annotations

import time
import traceback
from abc import abstractmethod
from collections.abc import Callable, Iterable
from typing import Any, Generic, TypeVar

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node

from uw_recon_ros.errors import ReconError
from uw_recon_ros.node_params import NodeParams
from uw_recon_ros.params import Params
from uw_recon_ros.ros.assembly import Group
from uw_recon_ros.ros.diagnostics import SUPERSEDED, Diagnostics, Throttle
from uw_recon_ros.ros.inputs import Inputs
from uw_recon_ros.ros.outputs import Outputs
from uw_recon_ros.ros.parameters import NodeParameters, ParameterSet
from uw_recon_ros.ros.qos import profile
from uw_recon_ros.ros.topics import Input, Output
from uw_recon_ros.ros.worker import Worker

S = TypeVar("S")
_REFRESH_S = 0.25
_DIAGNOSTICS_S = 1.0
_LONGEST_LATENCY_S = 3600.0


def _all_classes() -> Iterable[type[Params]]:
    """The parameters of every node; imported only when there is a name to explain."""
    from uw_recon_ros.catalogue import ALL_PARAMS

    return ALL_PARAMS


class StageNode(Node, Generic[S]):  # type: ignore[misc]
    """Base of the stage nodes.

    A subclass says which topics go in and out and implements `build` (parameters -> stage) and `work` (stage and
    messages -> messages). Whatever a frame's data did wrong ends here: the frame is dropped, counted and reported.

    Parameters
    ----------
    name : str
    classes : iterable of type
        `Params` classes the node has besides `NodeParams`.
    inputs : iterable of Input
    outputs : iterable of Output
    options
        Passed to ``rclpy.node.Node``.

    Raises
    ------
    ParameterError
        A parameter override is refused.

    Attributes
    ----------
    diagnostics : Diagnostics
    inputs : Inputs
    outputs : Outputs
    stage : object or None
        What `build` made last; None while it makes the first.
    """

    def __init__(
        self,
        name: str,
        *,
        classes: Iterable[type[Params]],
        inputs: Iterable[Input],
        outputs: Iterable[Output],
        **options: Any,
    ) -> None:
        super().__init__(name, **options)
        self._warn = Throttle(self.get_logger().warning)
        self.diagnostics = Diagnostics(on_problem=self._warn)
        self._declared = NodeParameters(self, (NodeParams, *classes), _all_classes)
        self.inputs = Inputs(self, inputs, self.diagnostics, self._warn, self._post)
        self.stage: S | None = None
        self.stage = self.build(self._declared.current)
        self._worker: Worker[Group] = Worker(name, self._work, self._begin)
        self._configure_inputs(self._declared.current)
        self._declared.watch(self._prepare)
        self.outputs = Outputs(self, outputs, self.diagnostics, self._follow_listeners)
        self._diagnostics_publisher = self.create_publisher(DiagnosticArray, "/diagnostics", profile())
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timers_kept = [
            self.create_timer(_REFRESH_S, self._follow_listeners, clock=steady),
            self.create_timer(_DIAGNOSTICS_S, self._publish_diagnostics, clock=steady),
        ]

    @abstractmethod
    def build(self, params: ParameterSet) -> S:
        """Make the stage; ``ValueError`` with the reason where the parameters do not allow it."""

    @abstractmethod
    def work(self, stage: S, group: Group) -> int:
        """Turn one group of messages into published ones; return the stamp, ns. In the worker's thread."""

    def warm_up(self, stage: S) -> None:
        """Prepare what would delay the first frame. In the worker's thread; overridden where there is something."""

    def configure(self, params: ParameterSet) -> None:
        """Adapt the inputs to the parameters. Overridden where there is something to adapt."""

    def stop(self, timeout_s: float = 1.0) -> bool:
        """Unsubscribe and finish the worker; return whether it finished in time."""
        self.inputs.deactivate()
        return self._worker.stop(timeout_s)

    def _configure_inputs(self, params: ParameterSet) -> None:
        node_params = params[NodeParams]
        self.inputs.assembler.tolerance_ns = round(node_params.pair_tolerance_ms * 1e6)
        self.inputs.stall_s = node_params.stall_warning_s
        self.configure(params)
        self.inputs.refresh()

    def _prepare(self, proposed: ParameterSet) -> Callable[[], None]:
        rebuild = self._declared.current.changed(proposed) - {NodeParams}
        stage = self.build(proposed) if rebuild else self.stage

        def commit() -> None:
            self.stage = stage
            self._configure_inputs(proposed)

        return commit

    def _follow_listeners(self) -> None:
        """Subscribe while somebody listens; look again at who publishes what."""
        wanted = self.outputs.wanted()
        if wanted == self.inputs.active:
            self.inputs.refresh()
        elif wanted:
            self.inputs.activate()
        else:
            self.inputs.deactivate()
            self._worker.mailbox.clear()

    def _post(self, group: Group) -> None:
        if self._worker.mailbox.put(group):
            self.diagnostics.drop(SUPERSEDED)

    def _begin(self) -> None:
        self._guarded(self.warm_up)

    def _work(self, group: Group) -> None:
        self._guarded(lambda stage: self._work_on(stage, group))

    def _work_on(self, stage: S, group: Group) -> None:
        started = time.monotonic()
        stamp = self.work(stage, group)
        self.diagnostics.count("done")
        self.diagnostics.measure("work [s]", time.monotonic() - started)
        latency_s = (self.get_clock().now().nanoseconds - stamp) * 1e-9
        if abs(latency_s) < _LONGEST_LATENCY_S:  # else the stamps are not of this clock: a replay without use_sim_time
            self.diagnostics.measure("latency [s]", latency_s)

    def _guarded(self, action: Callable[[S], None]) -> None:
        """Do something with the stage; what goes wrong costs the frame, not the node."""
        stage = self.stage
        assert stage is not None
        try:
            action(stage)
        except (ReconError, ValueError) as error:
            self._drop(type(error).__name__, str(error))
        except Exception as error:  # a bug of ours, or of a library: the node must live to report it
            if self.context.ok():
                self._drop(f"internal {type(error).__name__}", f"internal error: {error!r}", traceback.format_exc())

    def _drop(self, reason: str, text: str, details: str = "") -> None:
        self.diagnostics.drop(reason, text)
        self._warn(f"{reason} {text[:40]}", f"frame dropped: {text}" + (f"\n{details}" if details else ""))

    def _publish_diagnostics(self) -> None:
        message = DiagnosticArray(status=[self.diagnostics.tick(self.get_fully_qualified_name())])
        message.header.stamp = self.get_clock().now().to_msg()
        self._diagnostics_publisher.publish(message)
