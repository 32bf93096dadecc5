"""The bag player: what is sent, when, and with which quality of service."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from helpers.ros_bench import Bench, texture
from rcl_interfaces.msg import Log
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image
from std_srvs.srv import Trigger

from uw_recon_ros.bags.model import QosProfile, RawMessage, TopicInfo
from uw_recon_ros.bags.reader import open_bag
from uw_recon_ros.bags.writer import BagWriter
from uw_recon_ros.errors import BagError
from uw_recon_ros.nodes.bag_player_node import BagPlayerNode
from uw_recon_ros.nodes.replay import Tally, parse, recorded_profile
from uw_recon_ros.ros import messages
from uw_recon_ros.ros.diagnostics import IDLE

SECOND = 1_000_000_000
START = 1_700_000_000 * SECOND
PERIOD = SECOND // 10
FRAMES = 6
IMAGE = texture(8, 12)


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six frames of two cameras, ten a second."""
    path = tmp_path_factory.mktemp("player") / "bag"
    with BagWriter(path) as writer:
        for frame in range(FRAMES):
            for side in ("left", "right"):
                stamp = START + frame * PERIOD
                writer.image(f"/{side}/image_raw", IMAGE + np.uint8(frame), time_ns=stamp, frame_id=side)
    return path


class Playing:
    """A player in a thread of its own."""

    def __init__(self, bench: Bench, path: Path, *arguments: str, **options: Any) -> None:
        self.reader = open_bag(path)
        settings = parse([str(path), *arguments], None)
        self.node = BagPlayerNode(self.reader, settings, context=bench.context, **options)
        self._thread = threading.Thread(target=self._play)
        self._thread.start()

    def _play(self) -> None:
        try:
            self.node.play()
        except Exception as error:
            self.error: Exception | None = error

    @property
    def done(self) -> bool:
        return not self._thread.is_alive()

    def close(self, bench: Bench) -> None:
        if not self.done:
            bench.context.try_shutdown()
        self._thread.join(10.0)
        self.node.close()
        self.reader.close()


@pytest.fixture
def play(bench: Bench) -> Iterator[Any]:
    playing: list[Playing] = []

    def start(*arguments: Any, **options: Any) -> Playing:
        playing.append(Playing(bench, *arguments, **options))
        return playing[-1]

    yield start
    for each in playing:
        each.close(bench)


def test_every_message_arrives_byte_for_byte(bench: Bench, bag: Path, play: Any) -> None:
    heard: list[bytes] = []
    bench.outsider.create_subscription(Image, "left/image_raw", heard.append, 50, raw=True)
    playing = play(bag, "--rate", "20", "--wait-for", "/left/image_raw")
    bench.spin_until(lambda: playing.done and len(heard) == FRAMES)
    with open_bag(bag) as reader:
        recorded = [message.data for message in reader.raw_messages(["/left/image_raw"])]
    assert [bytes(message) for message in heard] == recorded


def test_it_keeps_time_at_a_rate(bench: Bench, bag: Path, play: Any) -> None:
    arrivals: list[float] = []
    bench.outsider.create_subscription(Image, "left/image_raw", lambda m: arrivals.append(time.monotonic()), 50)
    play(bag, "--rate", "0.5", "--wait-for", "/left/image_raw")
    bench.spin_until(lambda: len(arrivals) == FRAMES)
    assert arrivals[-1] - arrivals[0] >= 0.9 * (FRAMES - 1) * 0.1 / 0.5  # never early; late is the machine's affair


def test_the_clock_follows_the_bag(bench: Bench, bag: Path, play: Any) -> None:
    clock = bench.listen(Clock, "/clock")
    playing = play(bag, "--rate", "2")
    bench.spin_until(lambda: playing.done)
    times = [m.clock.sec * SECOND + m.clock.nanosec for m in clock]
    assert times == sorted(times)
    assert START <= times[0] < times[-1]
    assert times[-1] <= START + 20 * FRAMES * PERIOD


def test_the_start_offset_skips(bench: Bench, bag: Path, play: Any) -> None:
    heard = bench.listen(Image, "left/image_raw")
    playing = play(bag, "--start-offset", "0.35", "--rate", "20", "--wait-for", "/left/image_raw")
    bench.spin_until(lambda: playing.done and len(heard) == 2)
    assert [messages.stamp_ns(m) - START for m in heard] == [4 * PERIOD, 5 * PERIOD]


def test_looping_begins_again(bench: Bench, bag: Path, play: Any) -> None:
    heard = bench.listen(Image, "left/image_raw")
    play(bag, "--loop", "--rate", "20", "--wait-for", "/left/image_raw")
    bench.spin_until(lambda: len(heard) > 2 * FRAMES)
    assert messages.stamp_ns(heard[FRAMES]) == START


def test_it_says_what_it_waits_for_and_gives_up_in_the_end(bench: Bench, bag: Path, play: Any) -> None:
    said = bench.listen(Log, "/rosout")
    playing = play(bag, "--rate", "20", "--wait-for-subscribers", "--wait-limit", "1")
    bench.spin_until(lambda: playing.done)
    assert playing.node.summary().startswith(f"sent {2 * FRAMES} messages")
    bench.spin_until(lambda: any("playing all the same" in each.msg for each in said), "the last line")
    lines = [each.msg for each in said if each.name == "bag_player_node"]
    assert any(
        line.startswith("waiting, 1 s at most, for a subscriber to any of /left/image_raw, /right/image_raw")
        for line in lines
    )


def reporter(bench: Bench, name: str, idle_s: list[float]) -> None:
    """A stage node that says how long it has been idle: the last of `idle_s`, anew every time."""
    talk = bench.talk(DiagnosticArray, "/diagnostics")
    status = DiagnosticStatus(name=name, values=[KeyValue(key=IDLE)])

    def report() -> None:
        status.values[0].value = f"{idle_s[-1]:.1f}"
        talk.publish(DiagnosticArray(status=[status]))

    bench.outsider.create_timer(0.2, report)


def test_after_the_bag_it_waits_for_whoever_is_at_work(bench: Bench, bag: Path, play: Any) -> None:
    """The slowest counts, however long the others have been idle."""
    slow, quick = [0.0], [100.0]
    for name, idle_s in (("/slow", slow), ("/quick", quick)):
        reporter(bench, name, idle_s)
    playing = play(bag, "--rate", "20", "--wait-for", "/left/image_raw", "--drain-limit", "1000")
    heard = bench.listen(Image, "left/image_raw")
    bench.spin_until(lambda: len(heard) == FRAMES)
    bench.spin_for(7.0)
    assert not playing.done
    slow.append(3.5)
    bench.spin_until(lambda: playing.done, "the player to end")


def test_it_does_not_wait_for_ever_for_who_is_at_work(bench: Bench, bag: Path, play: Any) -> None:
    said = bench.listen(Log, "/rosout")
    reporter(bench, "/stuck", [0.0])
    playing = play(bag, "--rate", "20", "--drain-limit", "6")
    bench.spin_until(lambda: playing.done)
    bench.spin_until(lambda: any(each.msg == "still at work after 6 s: /stuck" for each in said), "who it was")


def call(bench: Bench, name: str) -> Any:
    client = bench.outsider.create_client(Trigger, f"/bag_player_node/{name}")
    bench.spin_until(client.service_is_ready)
    future = client.call_async(Trigger.Request())
    bench.spin_until(future.done)
    return future.result()


def test_pause_step_and_resume(bench: Bench, bag: Path, play: Any) -> None:
    left, right = bench.listen(Image, "left/image_raw"), bench.listen(Image, "right/image_raw")
    playing = play(bag, "--start-paused", "--rate", "10", "--wait-for", "/left/image_raw", "/right/image_raw")
    for frame in (1, 2):
        assert call(bench, "step").success
        bench.spin_until(lambda frame=frame: (len(left), len(right)) == (frame, frame))
    bench.spin_for(0.3)
    assert (len(left), len(right)) == (2, 2)
    assert call(bench, "resume").success
    assert not call(bench, "step").success or playing.done
    bench.spin_until(lambda: playing.done and len(left) == FRAMES)


def test_a_pause_holds(bench: Bench, bag: Path, play: Any) -> None:
    heard = bench.listen(Image, "left/image_raw")
    playing = play(bag, "--loop", "--wait-for", "/left/image_raw")
    bench.spin_until(lambda: heard)
    assert call(bench, "pause").success
    count = len(heard)
    bench.spin_for(0.5)
    assert len(heard) <= count + 1
    assert not playing.done


def test_it_waits_until_somebody_listens_and_then_a_little_more(bench: Bench, bag: Path, play: Any) -> None:
    playing = play(bag, "--rate", "100", "--wait-for-subscribers")
    bench.spin_for(0.5)
    assert not playing.done
    heard = bench.listen(Image, "right/image_raw")
    bench.spin_until(lambda: playing.done and len(heard) == FRAMES)


def test_topics_move_with_the_name_space(bench: Bench, bag: Path, play: Any) -> None:
    heard = bench.listen(Image, "/rov/left/image_raw")
    play(bag, "--wait-for", "/left/image_raw", namespace="/rov")
    bench.spin_until(lambda: heard)


def test_only_chosen_topics(bench: Bench, bag: Path, play: Any) -> None:
    playing = play(bag, "--topics", "/left/image_raw", "--rate", "100")
    bench.spin_until(lambda: playing.done)
    assert "(/left/image_raw 6)" in playing.node.summary()


def write_foreign(path: Path) -> Path:
    """A bag with a type that nobody here has a package for."""
    from mcap.writer import Writer

    image = Image(width=1, height=1, encoding="mono8", step=1)
    image.data.frombytes(b"7")
    with path.open("wb") as stream:
        writer = Writer(stream)
        writer.start("ros2")
        for topic, kind, data in (
            ("/left/image_raw", "sensor_msgs/msg/Image", serialize_message(image)),
            ("/thruster", "rov_msgs/msg/Thruster", b"\0\1\0\0"),
        ):
            schema = writer.register_schema(kind, "ros2msg", b"uint8 x")
            channel = writer.register_channel(topic, "cdr", schema)
            writer.add_message(channel, log_time=START, publish_time=START, data=data)
        writer.finish()
    return path


def test_unknown_types_are_skipped_with_a_line(
    bench: Bench, tmp_path: Path, play: Any, capfd: pytest.CaptureFixture[str]
) -> None:
    playing = play(write_foreign(tmp_path / "foreign.mcap"))
    bench.spin_until(lambda: playing.done)
    lines = [line for line in capfd.readouterr().err.splitlines() if "/thruster" in line]
    assert len(lines) == 1
    assert "rov_msgs/msg/Thruster" in lines[0]
    assert "(/left/image_raw 1)" in playing.node.summary()


def test_a_bag_with_nothing_to_play(bench: Bench, bag: Path) -> None:
    with (
        open_bag(bag) as reader,
        pytest.raises(BagError, match="expected topics that can be played, the bag has /left"),
    ):
        BagPlayerNode(reader, parse([str(bag), "--topics", "/nothing"], None), context=bench.context)


def test_waiting_for_a_topic_that_is_not_played(bench: Bench, bag: Path) -> None:
    with open_bag(bag) as reader, pytest.raises(BagError, match="expected topics that are played, got /sonar"):
        BagPlayerNode(reader, parse([str(bag), "--wait-for", "/sonar"], None), context=bench.context)


def test_an_offset_beyond_the_end(bench: Bench, bag: Path) -> None:
    with open_bag(bag) as reader, pytest.raises(BagError, match=r"at most the bag's 0\.500 s, got 9"):
        BagPlayerNode(reader, parse([str(bag), "--start-offset", "9"], None), context=bench.context)


@pytest.mark.parametrize(
    "arguments", [["bag", "--rate", "0"], ["bag", "--rate", "fast"], [], ["bag", "--start-offset", "-1"]]
)
def test_wrong_usage_is_exit_code_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        parse(arguments, None)
    assert caught.value.code == 2


RELIABLE, BEST_EFFORT = QosProfile(), QosProfile(reliability="best_effort", depth=5)
LATCHED = QosProfile(durability="transient_local", depth=1)


@pytest.mark.parametrize(
    ("recorded", "reliability", "durability", "depth"),
    [
        ((), ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE, 10),
        ((BEST_EFFORT,), ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE, 10),
        ((BEST_EFFORT, RELIABLE), ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE, 10),
        ((LATCHED,), ReliabilityPolicy.RELIABLE, DurabilityPolicy.TRANSIENT_LOCAL, 25),
        ((LATCHED, RELIABLE), ReliabilityPolicy.RELIABLE, DurabilityPolicy.VOLATILE, 10),
    ],
)
def test_quality_of_service_is_the_recorded_one(
    recorded: tuple[QosProfile, ...], reliability: Any, durability: Any, depth: int
) -> None:
    offered: QoSProfile = recorded_profile(TopicInfo("/x", "sensor_msgs/msg/Image", 25, recorded))
    assert (offered.reliability, offered.durability, offered.depth) == (reliability, durability, depth)


def test_a_latched_topic_reaches_those_who_come_late(bench: Bench, tmp_path: Path, play: Any) -> None:
    info = RawMessage("/left/camera_info", "sensor_msgs/msg/CameraInfo", START, serialize_message(CameraInfo(width=3)))
    with BagWriter(tmp_path / "latched") as writer:
        writer.raw(info, [LATCHED])
        writer.image("/left/image_raw", IMAGE, time_ns=START + 100 * SECOND, frame_id="left")
    play(tmp_path / "latched")
    bench.spin_for(0.3)
    heard: list[CameraInfo] = []
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    bench.outsider.create_subscription(CameraInfo, "left/camera_info", heard.append, latched)
    bench.spin_until(lambda: heard)
    assert heard[0].width == 3


def test_the_report() -> None:
    tally = Tally()
    for late_s in (0.001, 0.002, 0.030):
        tally.sent("/left/image_raw")
        tally.late(late_s)
    assert tally.line(1.5, 2.0) == (
        "sent 3 messages in 1.50 s at rate 2 (/left/image_raw 3), late by 2.0 ms median, 30.0 ms at most"
    )
    assert "nothing" in Tally().line(0.0, 1.0)
