"""Looking at a running graph for `doctor`: joins it, listens for some seconds, asks the nodes.

The probe subscribes to what the stages publish last, so that nodes which rest while nobody listens begin to work.
"""

from __future__ import annotations

import time
from collections import Counter
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from rosgraph_msgs.msg import Clock as ClockMessage

from uw_recon_ros.doctor.observation import ClockSight, GraphNode, NodeStatus, Observation, ObservedTopic, Surroundings
from uw_recon_ros.doctor.suggestions import actual_names
from uw_recon_ros.doctor.topic_graph import LISTENED, METRIC_CLOUD, NODES, TYPES
from uw_recon_ros.doctor.topic_graph import UNSCALED_CLOUD as UNSCALED
from uw_recon_ros.ros.message_types import message_class
from uw_recon_ros.ros.observer.node_answers import Asked
from uw_recon_ros.ros.observer.recorder import Recorder, camera_numbers, endpoint
from uw_recon_ros.ros.qos import profile
from uw_recon_ros.topics import CAMERA_INFO, POINT_CLOUD, SIDES, TRANSPORTS

NAME = "uw_recon_doctor"
_LOOK_S = 0.25
_LEAST_S, _ENOUGH_CLOUDS = 3.0, 3
#: Tools that join a graph without being part of it.
_TOOLS = ("_ros2cli", "launch_ros", NAME)


class Probe(Node):  # type: ignore[misc]
    """The doctor's node.

    Parameters
    ----------
    around : Surroundings
    options
        Passed to ``rclpy.node.Node``; ``namespace`` is that of the graph to look at.
    """

    def __init__(self, around: Surroundings, **options: Any) -> None:
        super().__init__(
            NAME, use_global_arguments=False, start_parameter_services=False, enable_rosout=False, **options
        )
        self._around, self._since = around, time.monotonic()
        self._resolved = {relative: self.resolve_topic_name(relative) for relative in TYPES}
        self._recorders: dict[str, Recorder] = {}
        self._subscriptions_kept: dict[str, Any] = {}
        self._asked: dict[str, Asked] = {}
        self._statuses: dict[str, list[NodeStatus]] = {}
        self._ticks: list[int] = []
        self.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 100)
        self.create_subscription(ClockMessage, "/clock", self._on_clock, profile(depth=1, reliable=False))
        self.create_timer(_LOOK_S, self.look, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.look()

    @property
    def seconds(self) -> float:
        """How long it has listened."""
        return time.monotonic() - self._since

    @property
    def satisfied(self) -> bool:
        """Whether clouds come, so that there is no need to wait on."""
        clouds = sum(self._recorders[name].count for name in (METRIC_CLOUD, UNSCALED) if name in self._recorders)
        return clouds >= _ENOUGH_CLOUDS and self.seconds >= _LEAST_S

    def look(self) -> None:
        """Look again at who is there; listen to what has come up; ask the nodes."""
        self._follow_remaps()
        for relative in LISTENED:
            self._listen(relative)
        services = {name for name, _ in self.get_service_names_and_types()}
        for name, space in self.get_node_names_and_namespaces():
            if name in NODES and space == self.get_namespace():
                self._asked.setdefault(name, Asked(self, f"{space.rstrip('/')}/{name}")).ask(services)

    def our_nodes(self) -> list[tuple[str, str]]:
        """Names and name spaces of our nodes, everywhere."""
        return [(name, space) for name, space in self.get_node_names_and_namespaces() if name in NODES]

    def observation(self) -> Observation:
        """Everything seen so far."""
        topics = {relative: self._topic(relative, name) for relative, name in self._resolved.items()}
        infos = {side: self._recorders.get(f"{side}/camera_info") for side in SIDES}
        clocks = [endpoint(end).node for end in self.get_publishers_info_by_topic("/clock")]
        names = [name for name in self.get_node_names() if not name.startswith(_TOOLS)]
        here = self.get_namespace()
        return Observation(
            namespace=here, seconds=self.seconds, topics=topics, others=self._others(), nodes=self._nodes(),
            elsewhere=tuple(f"{space.rstrip('/')}/{name}" for name, space in self.our_nodes() if space != here),
            infos={side: camera_numbers(r.last) for side, r in infos.items() if r is not None and r.count},
            clock=ClockSight(tuple(clocks), len(self._ticks), *(self._ticks[:1] + self._ticks[-1:])),
            surroundings=Surroundings(**{**vars(self._around), "nodes_seen": len(names)}),
        )  # fmt: skip

    def _follow_remaps(self) -> None:
        """Take our nodes' camera topics from what they subscribe to."""
        here, heard = self.get_namespace(), {}
        for name, space in self.our_nodes():
            if space == here:
                for topic, types in self.get_subscriber_names_and_types_by_node(name, space):
                    heard[topic] = types[0]
        if heard:
            self._resolved.update(actual_names(heard, self._resolved))

    def _listen(self, relative: str) -> None:
        name, kind = self._resolved[relative], TYPES[relative]
        if relative in self._subscriptions_kept:
            if self._subscriptions_kept[relative].topic_name == name:
                return
            self.destroy_subscription(self._subscriptions_kept.pop(relative))
        ends = [endpoint(end) for end in self.get_publishers_info_by_topic(name)]
        message = message_class(kind)
        if message is None or not ends or any(end.type != kind for end in ends):
            return
        reliable = all(end.reliable for end in ends)  # as our nodes do: with a best-effort publisher, best effort
        recorder = self._recorders[relative] = Recorder()
        self._subscriptions_kept[relative] = self.create_subscription(
            message, name, recorder, profile(reliable=reliable)
        )

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            self._statuses.setdefault(status.name, []).append(NodeStatus(status.level[0], status.message, values))

    def _on_clock(self, message: ClockMessage) -> None:
        self._ticks.append(message.clock.sec * 1_000_000_000 + message.clock.nanosec)

    def _topic(self, relative: str, name: str) -> ObservedTopic:
        seen = self._ends(name)
        recorder = self._recorders.get(relative)
        return (
            ObservedTopic(seen.name, seen.publishers, seen.subscribers, recorder.arrivals(self.seconds))
            if recorder
            else seen
        )

    def _ends(self, name: str) -> ObservedTopic:
        """Both ends of a topic, ours left out."""
        publishers, subscribers = (
            tuple(end for end in map(endpoint, infos) if not end.node.endswith(f"/{NAME}"))
            for infos in (self.get_publishers_info_by_topic(name), self.get_subscriptions_info_by_topic(name))
        )
        return ObservedTopic(name, publishers, subscribers)

    def _others(self) -> tuple[ObservedTopic, ...]:
        wanted, ours = {*TRANSPORTS.values(), CAMERA_INFO, POINT_CLOUD}, set(self._resolved.values())
        names = [name for name, types in self.get_topic_names_and_types() if name not in ours and wanted & set(types)]
        return tuple(self._ends(name) for name in names)

    def _nodes(self) -> dict[str, GraphNode]:
        copies = Counter(name for name, space in self.our_nodes() if space == self.get_namespace())
        return {
            name: GraphNode(
                name=(full := f"{self.get_namespace().rstrip('/')}/{name}"), copies=copies[name],
                lifecycle=asked.state if asked.managed else None, answers=asked.answers,
                parameters=asked.parameters, statuses=tuple(self._statuses.get(full, ())),
            )
            for name, asked in self._asked.items()
            if copies[name]
        }  # fmt: skip
