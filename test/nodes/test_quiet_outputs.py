"""Topics that everybody listens to, such as `/tf_static`: told once, kept for whoever comes, no reason to work."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
from geometry_msgs.msg import TransformStamped
from helpers.ros_bench import Bench
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Header

from uw_recon_ros.nodes.rectify_node import RectifyNode
from uw_recon_ros.ros import rectified_frame
from uw_recon_ros.ros.declared_topics import Output
from uw_recon_ros.ros.diagnostics import Diagnostics
from uw_recon_ros.ros.outputs import Outputs, Publishers
from uw_recon_ros.types import StereoGeometry

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
TOPIC = "frames"
GEOMETRY = StereoGeometry(100.0, 10.0, 10.0, 5.0)


@pytest.fixture
def outputs(bench: Bench) -> Iterator[Outputs]:
    topics = (Output(TOPIC, TransformStamped, latched=True, quiet=True), Output("news", Header))
    publishers = Publishers(bench.outsider, topics, lambda: None)
    yield Outputs(publishers, Diagnostics())
    publishers.destroy()


def message(child: str) -> TransformStamped:
    return TransformStamped(child_frame_id=child)


def listen(bench: Bench) -> list[Any]:
    heard: list[Any] = []
    bench.outsider.create_subscription(TransformStamped, TOPIC, heard.append, LATCHED)
    return heard


def test_who_comes_late_is_told(bench: Bench, outputs: Outputs) -> None:
    outputs.tell(TOPIC, "a", lambda: message("a"))
    heard = listen(bench)
    bench.spin_until(lambda: heard)
    assert [m.child_frame_id for m in heard] == ["a"]


def test_only_news_is_told(bench: Bench, outputs: Outputs) -> None:
    heard = listen(bench)
    for value in ("a", "a", "b", "b", "b"):
        outputs.tell(TOPIC, value, lambda value=value: message(value))
    bench.spin_until(lambda: heard and heard[-1].child_frame_id == "b")
    bench.spin_for(0.1)
    assert [m.child_frame_id for m in heard] in (["a", "b"], ["b"])  # a reader that is not found yet misses the first


def test_its_listeners_make_nobody_work(bench: Bench, outputs: Outputs) -> None:
    listen(bench)
    bench.spin_until(lambda: bench.outsider.count_subscribers(TOPIC))
    bench.spin_for(0.1)
    assert not outputs.wanted()
    assert not outputs.wanted(TOPIC, "news")
    bench.listen(Header, "news")
    bench.spin_until(outputs.wanted)


def test_nothing_is_told_after_the_end(bench: Bench, outputs: Outputs) -> None:
    heard = listen(bench)
    outputs.close()
    outputs.tell(TOPIC, "a", lambda: message("a"))
    bench.spin_for(0.2)
    assert heard == []


def test_a_node_without_the_topic_keeps_silent(outputs: Outputs) -> None:
    """Where tf2_msgs is missing, and where it is there but the node does not publish it."""
    rectified_frame.tell_rectified_frame(outputs, GEOMETRY, 0, "left")


def test_tf_is_told_where_it_is_installed(bench: Bench) -> None:
    tf2_msgs = pytest.importorskip("tf2_msgs.msg", reason="tf2_msgs is part of ROS 2, not of the wheels")
    assert [output.topic for output in rectified_frame.OUTPUTS] == ["/tf_static"]
    publishers = Publishers(bench.start(RectifyNode), rectified_frame.OUTPUTS, lambda: None)
    rectified_frame.tell_rectified_frame(Outputs(publishers, Diagnostics()), GEOMETRY, 0, "left")
    heard: list[Any] = []
    bench.outsider.create_subscription(tf2_msgs.TFMessage, "/tf_static", heard.append, LATCHED)
    bench.spin_until(lambda: heard)
    (transform,) = heard[0].transforms
    assert (transform.header.frame_id, transform.child_frame_id) == ("left", "left_rectified")
