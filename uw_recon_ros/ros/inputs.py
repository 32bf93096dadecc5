"""A node's subscriptions: which topic serves an input, and what belongs together."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Any

from rclpy.node import Node

from uw_recon_ros.errors import ReconError
from uw_recon_ros.files.video_packets import is_video
from uw_recon_ros.messages.headers import received_stamp_ns
from uw_recon_ros.ros.declared_topics import Input, InputTopic
from uw_recon_ros.ros.diagnostics import PASSED_OVER, Diagnostics
from uw_recon_ros.ros.message_groups import Assembler, Group
from uw_recon_ros.ros.qos import ReliableFirst
from uw_recon_ros.ros.rate_limiter import Pace
from uw_recon_ros.ros.topic_health import in_one_line, not_installed, why_silent, why_unpaired
from uw_recon_ros.ros.video import VideoStream

_PATIENCE = 3  # gaps between messages without one, before a slow topic counts as silent


@dataclass
class _Line:
    """The subscription of one input."""

    chosen: InputTopic
    subscription: ReliableFirst
    video: VideoStream = field(default_factory=VideoStream)
    since: float = field(default_factory=time.monotonic)
    gap: float = 0.0
    last_stamp: int | None = None

    def received(self, stamp: int) -> None:
        """Note a message; `gap` is the time since the one before."""
        now = time.monotonic()
        self.gap = now - self.since if self.last_stamp is not None else 0.0
        self.since, self.last_stamp = now, stamp


class Inputs:
    """The subscriptions of a node, there only while it has work to do.

    All methods belong to the executor's thread.

    Parameters
    ----------
    node : Node
    inputs : iterable of Input
    diagnostics : Diagnostics
    warn : callable
        Called with a key and one line of text; expected to throttle lines of one key.
    deliver : callable
        Called with each complete group.

    Attributes
    ----------
    assembler : Assembler
    ignored : frozenset of str
        Inputs not wanted at present.
    accepts : callable
        Whether an `InputTopic` may be taken at present.
    stall_s : float
        Silence before a warning, s.
    pace : Pace
        Which groups are delivered.
    """

    def __init__(
        self,
        node: Node,
        inputs: Iterable[Input],
        diagnostics: Diagnostics,
        warn: Callable[[str, str], None],
        deliver: Callable[[Group], None],
    ) -> None:
        self._node, self._inputs, self._diagnostics, self._warn = node, tuple(inputs), diagnostics, warn
        self.assembler = Assembler(self._deliver, lambda reason, number: diagnostics.drop(reason, number=number))
        self._downstream = deliver
        self._lines: dict[str, _Line] = {}
        self.active = False
        self.ignored: frozenset[str] = frozenset()
        self.accepts: Callable[[InputTopic], bool] = lambda topic: True
        self.stall_s = 5.0
        self.pace = Pace()
        self._last_group = 0.0

    def activate(self) -> None:
        """Subscribe."""
        self.active, self._last_group = True, time.monotonic()
        self.refresh()

    def deactivate(self) -> None:
        """Unsubscribe and forget."""
        self.active = False
        for name in list(self._lines):
            self._close(name)
        self.assembler.reset()
        for key in ("silent", "unpaired"):
            self._diagnostics.problem(key, None)

    def refresh(self) -> None:
        """Look again at who publishes what; cheap, called on every change and a few times a second."""
        if not self.active:
            return
        for wanted in self._inputs:
            self._attend(wanted)
        read = [i for i in self._inputs if i.name not in self.ignored]
        self.assembler.expect(
            [i.name for i in read if i.role == "paired" or (i.role == "optional" and self._served(i))],
            [i.name for i in read if i.role == "latest" and self._served(i)],
        )
        self._look_for_stalls()

    def publishers(self) -> dict[str, int]:
        """How many publishers the subscription to each topic read at present has found."""
        return {line.chosen.name: line.subscription.publishers for line in self._lines.values()}

    def has_publisher(self, topic: str) -> bool:
        """Whether anybody publishes `topic`, remapped as this node's subscription is."""
        return bool(self._node.count_publishers(self._node.resolve_topic_name(topic)) > 0)

    def _served(self, wanted: Input) -> bool:
        line = self._lines.get(wanted.name)
        return line is not None and self.has_publisher(line.chosen.name)

    def _attend(self, wanted: Input) -> None:
        """Subscribe to the topic that fits best now."""
        line = self._lines.get(wanted.name)
        alternatives = [] if wanted.name in self.ignored else self._alternatives(wanted)
        if not alternatives:
            self._close(wanted.name)
            return
        current = line.chosen if line is not None and line.chosen in alternatives else alternatives[0]
        best = next((s for s in alternatives if self.has_publisher(s.name)), current)
        if line is None or line.chosen != best:
            self._close(wanted.name)
            self._lines[wanted.name] = _Line(best, self._subscribe(wanted, best))

    def _alternatives(self, wanted: Input) -> list[InputTopic]:
        """What may serve an input at present, and can."""
        return [topic for topic in wanted.alternatives if topic.type is not None and self.accepts(topic)]

    def _subscribe(self, wanted: Input, topic: InputTopic) -> ReliableFirst:
        return ReliableFirst(
            self._node, topic.type, topic.name,
            lambda message: self._receive(wanted, topic, message),
            on_fallback=lambda text: self._warn(f"qos {topic.name}", text),
            on_match=self.refresh,
            on_lost=lambda number: self._diagnostics.drop(f"lost on the way: {topic.name}", number=number),
        )  # fmt: skip

    def _close(self, name: str) -> None:
        line = self._lines.pop(name, None)
        if line is not None:
            line.subscription.destroy()

    def _receive(self, wanted: Input, topic: InputTopic, message: Any) -> None:
        line = self._lines.get(wanted.name)
        if line is None or line.chosen != topic:  # still in the queue of a subscription just given up
            return
        self._diagnostics.count(f"in {topic.name}")
        try:
            stamp = received_stamp_ns(message)
            taken = line.video.take(message, stamp) if is_video(message) else message
        except ReconError as error:
            self._refuse(topic.name, error)
            return
        line.received(stamp)
        if wanted.role == "latest":
            self.assembler.set_latest(wanted.name, taken)
        else:
            self.assembler.push(wanted.name, stamp, taken, _size(message))

    def _refuse(self, topic: str, error: ReconError) -> None:
        self._diagnostics.drop(type(error).__name__, f"{topic}: {error}", code=error.code)
        self._warn(f"refused {topic}", f"message refused: {topic}: {error}")

    def _deliver(self, group: Group) -> None:
        self._last_group = time.monotonic()
        self._diagnostics.count("in groups")
        if self.pace.lets_through():
            self._downstream(group)
        else:
            self._diagnostics.drop(PASSED_OVER)

    def _look_for_stalls(self) -> None:
        now = time.monotonic()
        silent = in_one_line(filter(None, (self._why_silent(wanted, now) for wanted in self._inputs)))
        apart = silent is None and now - self._last_group > self.stall_s
        self._diagnostics.problem("silent", silent)
        self._diagnostics.problem("unpaired", self._why_unpaired() if apart else None)

    def _why_silent(self, wanted: Input, now: float) -> tuple[str, str] | None:
        line = self._lines.get(wanted.name)
        if line is None or now - line.since <= max(self.stall_s, _PATIENCE * line.gap):
            return None
        for topic in wanted.alternatives:
            if topic.type is None and self.accepts(topic) and self.has_publisher(topic.name):
                return self._node.resolve_topic_name(topic.name), not_installed(topic.name)
        alternatives = [topic.name for topic in self._alternatives(wanted)]
        return why_silent(self._node, line.chosen.name, alternatives, required=wanted.role == "paired")

    def _why_unpaired(self) -> str | None:
        if self.assembler.awaited:
            return f"waiting for the first message of {', '.join(sorted(self.assembler.awaited))}"
        paired = [self._lines[i.name] for i in self._inputs if i.role != "latest" and i.name in self._lines]
        stamps = {line.chosen.name: line.last_stamp for line in paired if line.last_stamp is not None}
        return why_unpaired(stamps, self.assembler.tolerance_ns)


def _size(message: Any) -> int:
    """Bytes of an image or disparity message; what else there is is small."""
    return len(getattr(getattr(message, "image", message), "data", b""))
