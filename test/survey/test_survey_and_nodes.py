"""What a survey computes from a bag is what the four nodes compute from its replay: every message, to the last bit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from helpers.dives import PARAMS, make_dive, recorded, with_half_a_camera
from helpers.ros_bench import Bench
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import CameraInfo, Image

from uw_recon_ros.bags import RawMessage, messages, open_bag, write_bag
from uw_recon_ros.cli import main
from uw_recon_ros.nodes.disparity_node import DisparityNode
from uw_recon_ros.nodes.pipeline_node import OUTPUTS
from uw_recon_ros.nodes.point_cloud_node import PointCloudNode
from uw_recon_ros.nodes.preprocess_node import PreprocessNode
from uw_recon_ros.nodes.rectify_node import RectifyNode
from uw_recon_ros.pipeline import read_values

FOUR = (PreprocessNode, RectifyNode, DisparityNode, PointCloudNode)
FRAMES = 2


def zero_padded(kind: str, data: bytes) -> bytes:
    """ROS leaves the padding between fields as it was in memory."""
    store = messages.typestore()
    return bytes(store.serialize_cdr(store.deserialize_cdr(data, kind), kind))


def replayed(dive: list[RawMessage], values: dict[str, Any]) -> dict[tuple[str, int], bytes]:
    """Bytes of every message of the graph, by topic and stamp; a frame is sent when the one before is through."""
    bench = Bench()
    try:
        for node in FOUR:
            own = {spec.name for spec in node_params(node)}
            bench.start(node, **{name: value for name, value in values.items() if name in own})
        own = [output for output in OUTPUTS if output.topic != "disparity/effort"]  # a survey's stands in its report
        heard = {output.topic: bench.listen(output.type, output.topic) for output in own}
        types = {"sensor_msgs/msg/Image": Image, "sensor_msgs/msg/CameraInfo": CameraInfo}
        talkers = {m.topic: bench.talk(types[m.type], m.topic.removeprefix("/")) for m in dive}
        bench.connected(*talkers.values())
        # Calibrations first: the newest one goes with an image.
        for stamp in sorted({m.log_ns for m in dive}):
            for message in sorted((m for m in dive if m.log_ns == stamp), key=lambda m: "info" not in m.topic):
                talkers[message.topic].publish(deserialize_message(message.data, types[message.type]))
            done = 1 + sum(m.log_ns < stamp for m in dive) // len(talkers)
            bench.spin_until(lambda done=done: len(heard["surface"]) >= done, "the surface")  # type: ignore[misc]
        bench.spin_for(0.2)
        return {
            (topic, stamp_of(message)): zero_padded(kind_of(message), serialize_message(message))
            for topic, got in heard.items()
            for message in got
        }
    finally:
        bench.close()


def node_params(node: Any) -> Any:
    from uw_recon_ros.catalogue import NODES

    names = {"PreprocessNode": "preprocess_node", "RectifyNode": "rectify_node", "DisparityNode": "disparity_node"}
    return NODES[names.get(node.__name__, "point_cloud_node")][0].specs()


def stamp_of(message: Any) -> int:
    return message.header.stamp.sec * 10**9 + message.header.stamp.nanosec


def kind_of(message: Any) -> str:
    return f"{type(message).__module__.split('.')[0]}/msg/{type(message).__name__}"


@pytest.mark.parametrize(("axis", "frames"), [("horizontal", FRAMES), ("vertical", FRAMES), ("half a camera", 4)])
def test_a_survey_equals_the_graph(axis: str, frames: int, tmp_path: Path) -> None:
    if axis == "half a camera":
        dive = tmp_path / "broken"
        write_bag(dive, with_half_a_camera(recorded(make_dive(tmp_path / "dive", frames=frames))))
    else:
        dive = make_dive(tmp_path / "dive", frames=frames, axis=axis)
    params = tmp_path / "small.yaml"
    params.write_text(PARAMS)
    assert (
        main(["survey", str(dive), "-o", str(tmp_path / "out"), "--params", str(params), "--quiet", "--jobs", "1"]) == 0
    )
    with open_bag(tmp_path / "out" / "bag") as bag:
        mine = {
            (m.topic.removeprefix("/"), stamp_of(decoded)): zero_padded(m.type, m.data) for m, decoded in bag.messages()
        }
    theirs = replayed(recorded(dive), read_values(params))
    assert {topic for topic, _ in theirs} == {topic for topic, _ in mine}
    assert len(mine) == frames * len({topic for topic, _ in mine})
    different = [key for key in mine if mine[key] != theirs[key]]
    assert not different
