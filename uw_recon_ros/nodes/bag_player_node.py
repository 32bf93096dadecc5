"""`bag_player_node`: replays a rosbag2 folder (MCAP or sqlite3) or a bare .mcap file to its topics and /clock.

Messages go out as the bytes that were recorded. Topics are published relative to the node's name space, with the
quality of service they were recorded with. Services (std_srvs/Trigger): ~/pause, ~/resume, ~/step; a step sends
messages up to the first topic that would come a second time: one frame of a camera rig.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from typing import Any

from rclpy.clock import Clock, ClockType
from rclpy.duration import Duration
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rosgraph_msgs.msg import Clock as ClockMessage
from std_srvs.srv import Trigger

from uw_recon_ros import stop_signals
from uw_recon_ros.bags.model import LATEST_NS, RawMessage
from uw_recon_ros.bags.reader import BagReader, open_bag
from uw_recon_ros.errors import BagError
from uw_recon_ros.nodes.drain import Drain
from uw_recon_ros.nodes.replay import Listeners, Tally, advertise_recorded, parse
from uw_recon_ros.nodes.timeline import Timeline
from uw_recon_ros.ros.message_types import message_class
from uw_recon_ros.ros.messages import time_message
from uw_recon_ros.ros.parameters import ParameterError
from uw_recon_ros.ros.process import DONE, FAILED, USAGE, leave, start, until_shutdown
from uw_recon_ros.ros.qos import profile

_POLL_S = 0.05
_SETTLE_S = 1.0
_ACKNOWLEDGE_S = 2.0
_MEET_S, _MEET_POLL_S = 1.0, 0.005
_LONGEST_SILENCE_S = 3600.0  # a damaged time of recording must not make it wait for decades


class BagPlayerNode(Node):  # type: ignore[misc]
    """Plays one bag.

    Parameters
    ----------
    bag : BagReader
    settings : Namespace
        Of `parse`.
    options
        Passed to ``rclpy.node.Node``.

    Raises
    ------
    BagError
        Nothing in the bag can be played.
    """

    def __init__(self, bag: BagReader, settings: argparse.Namespace, **options: Any) -> None:
        super().__init__("bag_player_node", **options)
        self._bag, self._settings = bag, settings
        self._begin_ns = bag.start_ns + round(settings.start_offset * 1e9)
        if bag.topics and self._begin_ns > bag.end_ns:
            length = (bag.end_ns - bag.start_ns) * 1e-9
            raise BagError(f"--start-offset: expected at most the bag's {length:.3f} s, got {settings.start_offset:g}")
        self._players = advertise_recorded(self, bag, settings.topics)
        unknown = set(settings.wait_for or ()) - self._players.keys()
        if unknown:
            raise BagError(f"--wait-for: expected topics that are played, got {', '.join(sorted(unknown))}")
        self._timeline = Timeline(self._begin_ns, settings.rate)
        self._tally = Tally()
        self._started_s = time.monotonic()
        self._kept = [
            self.create_service(Trigger, f"~/{name}", answer)
            for name, answer in (("pause", self._on_pause), ("resume", self._on_resume), ("step", self._on_step))
        ]
        if settings.drain_limit:
            self._drain = Drain(self)
        if settings.clock_rate:
            self._clock_publisher = self.create_publisher(ClockMessage, "/clock", profile(depth=1))
            steady = Clock(clock_type=ClockType.STEADY_TIME)
            self._kept.append(self.create_timer(1 / settings.clock_rate, self._publish_clock, clock=steady))
        self._executor = SingleThreadedExecutor(context=self.context)
        self._executor.add_node(self)

    def play(self) -> None:
        """Play to the end, or for ever where looping."""
        self._wait_for_subscribers()
        self._meet_listeners()
        self._started_s = time.monotonic()
        if not self._settings.start_paused:
            self._timeline.resume(self._started_s)
        while True:
            for message in self._from_start():
                self._wait_until_due(message)
                self._send(message)
            if not self._settings.loop:
                self._let_arrive()
                return self._let_drain()
            self._timeline.jump(self._begin_ns, time.monotonic())

    def summary(self) -> str:
        """What was sent, in one line."""
        return self._tally.line(time.monotonic() - self._started_s, self._settings.rate)

    def close(self) -> None:
        """Stop the executor and destroy the node."""
        self._executor.shutdown()
        self.destroy_node()

    def _from_start(self) -> Iterator[RawMessage]:
        wanted = self._bag.raw_messages(self._players)
        return (
            message
            for message in wanted
            if message.log_ns >= self._begin_ns and message_class(message.type) is self._players[message.topic].msg_type
        )

    def _wait_for_subscribers(self) -> None:
        listeners = Listeners(self.get_logger().info, self._spin, self._settings.wait_limit)
        if self._settings.wait_for:
            listeners.wait([self._players[name] for name in self._settings.wait_for], all, 0.0)
        if self._settings.wait_for_subscribers:
            listeners.wait(list(self._players.values()), any, _SETTLE_S)

    def _meet_listeners(self) -> None:
        """Give publishers the time to find the subscribers that the graph knows of; one of other QoS never is."""
        deadline = time.monotonic() + _MEET_S
        while self._strangers() and time.monotonic() < deadline:
            self._spin(_MEET_POLL_S)

    def _strangers(self) -> bool:
        return any(p.get_subscription_count() < self.count_subscribers(p.topic_name) for p in self._players.values())

    def _wait_until_due(self, message: RawMessage) -> None:
        self._spin(0.0)
        while True:
            if self._timeline.paused:
                if self._timeline.step_begins:
                    self._meet_listeners()
                if self._timeline.take_step(message.topic, message.log_ns):
                    return
                self._spin(_POLL_S)
                continue
            wait = self._timeline.due_s(message.log_ns) - time.monotonic()
            if wait > _LONGEST_SILENCE_S:
                self.get_logger().warning(f"nothing recorded for {wait:.0f} s (at this rate): skipped")
                self._timeline.jump(message.log_ns, time.monotonic())
                wait = 0.0
            if wait <= 0:
                self._tally.late(-wait)
                return
            self._spin(min(wait, _POLL_S))

    def _send(self, message: RawMessage) -> None:
        self._players[message.topic].publish(message.data)
        self._tally.sent(message.topic)

    def _let_arrive(self) -> None:
        """Give reliable subscribers the time to get what was sent last."""
        deadline = time.monotonic() + _ACKNOWLEDGE_S
        for publisher in self._players.values():
            left_s = max(deadline - time.monotonic(), 0.0)
            publisher.wait_for_all_acked(Duration(nanoseconds=round(left_s * 1e9)))

    def _let_drain(self) -> None:
        """Give the nodes the time to work on the last pair."""
        if not self._settings.drain_limit:
            return
        self.get_logger().info(f"the bag has ended: waiting, {self._settings.drain_limit:g} s at most, for the nodes")
        gave_up = self._drain.wait(self._settings.drain_limit, lambda: self._spin(_POLL_S))
        if gave_up is not None:
            self.get_logger().warning(gave_up)

    def _spin(self, timeout_s: float) -> None:
        self._executor.spin_once(timeout_sec=timeout_s)
        if stop_signals.came() or not self.context.ok():
            raise ExternalShutdownException

    def _publish_clock(self) -> None:
        now_ns = min(self._timeline.now_ns(time.monotonic()), LATEST_NS - 1)
        self._clock_publisher.publish(ClockMessage(clock=time_message(now_ns)))

    def _on_pause(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._timeline.pause(time.monotonic())
        response.success, response.message = True, "paused"
        return response

    def _on_resume(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        self._timeline.resume(time.monotonic())
        response.success, response.message = True, "playing"
        return response

    def _on_step(self, _: Trigger.Request, response: Trigger.Response) -> Trigger.Response:
        response.success = self._timeline.paused
        if response.success:
            self._timeline.begin_step()
        response.message = "stepping" if response.success else "expected a paused player: call ~/pause first"
        return response


def main(args: Sequence[str] | None = None) -> int:
    """Play a bag; return the exit code."""
    player, code = None, DONE
    try:
        with until_shutdown():
            start(args)
            settings = parse(args, __doc__)
            with open_bag(settings.bag) as bag:
                player = BagPlayerNode(bag, settings)
                player.play()
                for sentence in bag.damage:
                    player.get_logger().warning(f"{bag.path}: {sentence}")
    except (BagError, ParameterError) as error:
        print(f"error: {error}", file=sys.stderr)  # noqa: T201
        code = USAGE if isinstance(error, ParameterError) else FAILED
    if player is not None:
        print(player.summary(), flush=True)  # noqa: T201
        player.close()
    return leave(code)


if __name__ == "__main__":
    sys.exit(main())
