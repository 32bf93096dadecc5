"""What was seen of a running graph, as plain values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True)
class Endpoint:
    """One publisher or subscriber of a topic.

    Parameters
    ----------
    node : str
        Full name of its node.
    type : str
        E.g. ``sensor_msgs/msg/Image``.
    type_hash : str
        Empty where the middleware does not tell.
    reliable : bool
        Offered or asked for; else best effort.
    latched : bool
        Transient local; else volatile.
    """

    node: str
    type: str
    type_hash: str = ""
    reliable: bool = True
    latched: bool = False


@dataclass(frozen=True)
class Arrivals:
    """What came on a topic while it was listened to.

    Parameters
    ----------
    count : int
    rate_hz : float
    stamps_ns : tuple of int
        Header stamps, in the order of arrival, ns.
    behind_ns : int
        Wall clock less stamp when the last message arrived, ns.
    width, height : int
        Of the last image, px; 0 where unknown (compressed) or none.
    encoding : str
        Of the last image.
    size_bytes : int
        Of the last message's data.
    frame_id : str
        Of the last message.
    valid_share : float or None
        Share of the last disparity's or organised cloud's pixels that have a value.
    """

    count: int = 0
    rate_hz: float = 0.0
    stamps_ns: tuple[int, ...] = ()
    behind_ns: int = 0
    width: int = 0
    height: int = 0
    encoding: str = ""
    size_bytes: int = 0
    frame_id: str = ""
    valid_share: float | None = None


@dataclass(frozen=True)
class ObservedTopic:
    """A topic, resolved, and who is on it; the doctor's own endpoints are left out."""

    name: str
    publishers: tuple[Endpoint, ...] = ()
    subscribers: tuple[Endpoint, ...] = ()
    arrivals: Arrivals = Arrivals()

    @property
    def types(self) -> frozenset[str]:
        """Types it is published with."""
        return frozenset(end.type for end in self.publishers)


@dataclass(frozen=True)
class NodeStatus:
    """What a node says of itself on ``/diagnostics``; `level` as in DiagnosticStatus: 0 ok, 1 warn, 2 error."""

    level: int
    message: str
    values: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class GraphNode:
    """A node of ours.

    Parameters
    ----------
    name : str
        Full name.
    copies : int
        How many nodes have that name.
    lifecycle : str or None
        State of a managed node, e.g. ``inactive``; empty where it did not answer; None: not managed.
    answers : bool
        Whether it answered when asked for its parameters.
    parameters : mapping
        Some of them.
    statuses : tuple of Status
        In the order they came.
    """

    name: str
    copies: int = 1
    lifecycle: str | None = None
    answers: bool = True
    parameters: Mapping[str, Any] = field(default_factory=dict)
    statuses: tuple[NodeStatus, ...] = ()


@dataclass(frozen=True)
class CameraNumbers:
    """The last camera_info of a camera; fields as the message's."""

    width: int
    height: int
    k: tuple[float, ...]
    d: tuple[float, ...]
    r: tuple[float, ...]
    p: tuple[float, ...]
    distortion_model: str = "plumb_bob"
    binning: tuple[int, int] = (0, 0)
    roi: tuple[int, int, int, int] = (0, 0, 0, 0)


@dataclass(frozen=True)
class ClockSight:
    """What was seen of ``/clock``; ns."""

    publishers: tuple[str, ...] = ()
    count: int = 0
    first_ns: int = 0
    last_ns: int = 0

    @property
    def stands_still(self) -> bool:
        """Whether it is published without moving on: a paused bag or simulation."""
        return self.count > 1 and self.first_ns == self.last_ns


@dataclass(frozen=True)
class Surroundings:
    """Machine and middleware, as this process has them.

    `udp_ports` are those in use on this machine, `tcp_ports` those listened on, `receive_bytes` is the most that a
    socket may be given to receive; `zenoh` holds the environment's ``ZENOH_*``.
    """

    domain: str = "0"
    discovery_range: str = ""
    rmw: str = ""
    profile: str = ""
    shm_free_bytes: int | None = None
    nodes_seen: int = 1
    udp_ports: tuple[int, ...] = ()
    tcp_ports: tuple[int, ...] = ()
    receive_bytes: int | None = None
    zenoh: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Observation:
    """Everything.

    Parameters
    ----------
    namespace : str
        Of the graph looked at, e.g. ``/`` or ``/rov``.
    seconds : float
        How long was listened, s.
    topics : mapping
        The chain's topics by relative name, see `chain.TYPES`.
    others : tuple of Topic
        All further topics of the domain.
    nodes : mapping
        Our nodes in the name space, by base name.
    elsewhere : tuple of str
        Full names of our nodes in other name spaces.
    infos : mapping
        Camera_infos by camera.
    clock : ClockSight
    surroundings : Surroundings
    """

    namespace: str = "/"
    seconds: float = 0.0
    topics: Mapping[str, ObservedTopic] = field(default_factory=dict)
    others: tuple[ObservedTopic, ...] = ()
    nodes: Mapping[str, GraphNode] = field(default_factory=dict)
    elsewhere: tuple[str, ...] = ()
    infos: Mapping[str, CameraNumbers] = field(default_factory=dict)
    clock: ClockSight = ClockSight()
    surroundings: Surroundings = Surroundings()

    def parameter(self, name: str, default: Any) -> Any:
        """Value of a parameter in the first of our nodes that has it."""
        return next((node.parameters[name] for node in self.nodes.values() if name in node.parameters), default)
