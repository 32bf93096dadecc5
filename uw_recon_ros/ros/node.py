"""The stage node: inputs paired, the newest group worked on in a thread, outputs only for those who listen."""

from __future__ import annotations

import time
from abc import abstractmethod
from collections.abc import Callable, Iterable
from typing import Any, Generic, TypeVar

from rclpy.clock import Clock, ClockType

from uw_recon_ros.node_params import NodeParams
from uw_recon_ros.params import Params
from uw_recon_ros.ros.declared_topics import Input, Output
from uw_recon_ros.ros.diagnostics import Diagnostics
from uw_recon_ros.ros.inputs import Inputs
from uw_recon_ros.ros.lifecycle import ManagedNode
from uw_recon_ros.ros.log_throttle import Throttle
from uw_recon_ros.ros.message_groups import Group
from uw_recon_ros.ros.outputs import Outputs, Publishers
from uw_recon_ros.ros.parameters import NodeParameters, ParameterError, ParameterSet
from uw_recon_ros.ros.reporter import Reporter
from uw_recon_ros.ros.session import NodeSession
from uw_recon_ros.topics import find_topic

S = TypeVar("S")
_REFRESH_S = 0.25


def _all_classes() -> Iterable[type[Params]]:
    """The parameters of every node; imported only when there is a name to explain."""
    from uw_recon_ros.catalogue import ALL_PARAMS

    return ALL_PARAMS


def _expect_installed(inputs: tuple[Input, ...], outputs: tuple[Output, ...]) -> None:
    """Refuse a node whose messages nobody installed."""
    types = {output.topic: output.type for output in outputs}
    for wanted in inputs:  # one of several will do
        installed = [topic for topic in wanted.alternatives if topic.type is not None]
        types |= {topic.name: topic.type for topic in installed or wanted.alternatives[:1]}
    absent = {find_topic(name).type.split("/")[0] for name, kind in types.items() if kind is None}
    if absent:
        text = f"{', '.join(sorted(absent))}: expected to be installed, not found: its messages are part of ROS 2"
        raise ParameterError(text)


class StageNode(ManagedNode, Generic[S]):
    """Base of the stage nodes.

    A subclass says which topics go in and out and implements `build` (parameters -> stage) and `work` (stage and
    messages -> messages). Whatever a frame's data did wrong ends in the `NodeSession`: the frame is dropped, counted
    and reported.

    Unconfigured, a node has parameters and diagnostics; configured, a `NodeSession`, which is warmed up; active, it
    subscribes as long as somebody listens. By ``autostart`` it becomes active by itself.

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
        A parameter override is refused, or messages it needs are not installed.

    Attributes
    ----------
    diagnostics : Diagnostics
    inputs : Inputs
    session : Session or None
        None while unconfigured.
    warn : Throttle
        Logs a warning, lines of one key not too often.
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
        inputs, outputs = tuple(inputs), tuple(outputs)
        _expect_installed(inputs, outputs)
        super().__init__(name, **options)
        self.session: NodeSession[S] | None = None
        self._ending: list[Callable[[float], bool]] = []
        self._outputs = tuple(outputs)
        self.warn = Throttle(self.get_logger().warning)
        self.diagnostics = Diagnostics(on_problem=self.warn)
        self._declared = NodeParameters(self, (NodeParams, *classes), _all_classes)
        self.inputs = Inputs(self, inputs, self.diagnostics, self.warn, self._post)
        self._check_parameters()
        self._declared.watch(self._prepare)
        self._reporter = Reporter(self)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._refresh_timer = self.create_timer(_REFRESH_S, self._follow_listeners, clock=steady)
        if self._declared.current[NodeParams].autostart:
            self.autostart()

    @abstractmethod
    def build(self, params: ParameterSet) -> S:
        """Make the stage; ``ValueError`` with the reason where the parameters do not allow it. Must be brief."""

    @abstractmethod
    def work(self, stage: S, group: Group, outputs: Outputs) -> int:
        """Turn one group of messages into published ones; return the stamp, ns. In the worker's thread."""

    def warm_up(self, stage: S) -> None:
        """Prepare what would delay the first frame. In the worker's thread; overridden where there is something."""

    def works_unasked(self, params: ParameterSet) -> bool:
        """Whether the node works though nobody listens. Overridden where it may."""
        return False

    def finished(self, stage: S, took_s: float) -> None:
        """Take note of how long `work` took, s. In the worker's thread; overridden where it matters."""

    def adapt_inputs(self, params: ParameterSet) -> None:
        """Adapt the inputs to the parameters. Overridden where there is something to adapt."""

    def adapt_to_listeners(self, outputs: Outputs) -> None:
        """Adapt the inputs to what is listened to. Overridden where some outputs need fewer of them."""

    def say_unasked(self, outputs: Outputs) -> None:
        """Say in the diagnostics what no frame tells. Once a second; overridden where there is something."""

    @property
    def stage(self) -> S | None:
        """What `build` made last; None while unconfigured."""
        return None if self.session is None else self.session.stage

    def configure(self) -> None:
        """Make stage and publishers, and begin to warm up."""
        stage = self.build(self._declared.current)
        self.session = NodeSession(self, stage, Publishers(self, self._outputs, self._follow_listeners))
        self._set_inputs(self._declared.current)

    def activate(self) -> None:
        """Subscribe, as long as somebody listens."""
        assert self.session is not None
        self.session.open()
        self._follow_listeners()

    def deactivate(self) -> None:
        """Unsubscribe; send nothing more, not even what is under way."""
        self.inputs.deactivate()
        if self.session is not None:
            self.session.close()

    def cleanup(self) -> None:
        """Free everything, what is known of the rig included."""
        if self.session is not None:
            self._ending = [ended for ended in (*self._ending, self.session.end()) if not ended(0.0)]
            self.session = None
        self.diagnostics.forget()

    def stop(self, timeout_s: float = 1.0) -> bool:
        """Shut down from whatever state; return whether all threads ended in time. The node is silent afterwards."""
        if self.context.ok():
            self.finalize()
        self.deactivate()  # where ROS was shut down first
        self.cleanup()
        self.warn.silence()
        end = time.monotonic() + timeout_s
        return all(ended(max(0.0, end - time.monotonic())) for ended in self._ending)

    def _check_parameters(self) -> None:
        try:
            self.build(self._declared.current)
        except ValueError as error:
            raise ParameterError(str(error)) from error

    def _prepare(self, proposed: ParameterSet) -> Callable[[], None]:
        session, stage = self.session, self.stage
        if session is None or self._declared.current.changed(proposed) - {NodeParams}:
            stage = self.build(proposed)

        def commit() -> None:
            if session is not None and stage is not None:
                session.stage = stage
            self._set_inputs(proposed)

        return commit

    def _set_inputs(self, params: ParameterSet) -> None:
        node_params = params[NodeParams]
        self.inputs.assembler.tolerance_ns = round(node_params.pair_tolerance_ms * 1e6)
        self.inputs.stall_s = node_params.stall_warning_s
        self.adapt_inputs(params)
        self.inputs.refresh()

    def _post(self, group: Group) -> None:
        if self.session is not None:
            self.session.post(group)

    def _follow_listeners(self) -> None:
        """Subscribe while somebody listens; look again at who publishes what."""
        if self.session is None or not self.session.outputs.open:
            return
        wanted = self.session.outputs.wanted() or self.works_unasked(self._declared.current)
        if wanted:
            self.adapt_to_listeners(self.session.outputs)
        if wanted == self.inputs.active:
            self.inputs.refresh()
        elif wanted:
            self.inputs.activate()
        else:
            self.inputs.deactivate()
            self.session.discard()
