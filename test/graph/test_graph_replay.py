"""A bag replayed through the executables, each a process, against the same bag reconstructed offline."""

from __future__ import annotations

from collections import defaultdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from helpers.graph_bench import FOUR
from helpers.ros_bench import BASELINE, FOCAL, FRAME, banded_pair, color, infos, infos_from_geometry
from helpers.ros_bench import HEIGHT as H
from helpers.ros_bench import WIDTH as W
from rclpy.serialization import serialize_message
from sensor_msgs.msg import Image, PointCloud2
from stereo_msgs.msg import DisparityImage

from uw_recon_ros.bags.model import RawMessage
from uw_recon_ros.bags.reader import open_bag
from uw_recon_ros.bags.writer import BagWriter
from uw_recon_ros.files.images import read_image
from uw_recon_ros.pipeline import Pipeline, PipelineParams, Products
from uw_recon_ros.ros import messages
from uw_recon_ros.types import StereoGeometry

pytestmark = [pytest.mark.graph, pytest.mark.timeout(3600)]
CANYON = Path(__file__).parents[3] / "shared" / "data" / "underwater" / "flsea_canyon"
SECOND = 1_000_000_000
FRAMES = 3
LIMITS = {"min_disparity": 0, "max_disparity": 24}
PARAMETERS = "/**:\n  ros__parameters:\n    min_disparity: 0\n    max_disparity: 24\n"
HEARD = {
    "disparity": DisparityImage,
    "disparity/status": Image,
    "depth/image_rect": Image,
    "points2": PointCloud2,
    "points_unscaled": PointCloud2,
}


def write(
    path: Path, *, calibrated: bool = True, vertical: bool = False, spoil: dict[int, Image] | None = None
) -> Path:
    """A bag of a rig that moves: every frame another texture. `spoil` replaces right images."""
    with BagWriter(path) as writer:

        def add(topic: str, message: Any, time_ns: int) -> None:
            kind = f"sensor_msgs/msg/{type(message).__name__}"
            writer.raw(RawMessage(topic, kind, time_ns, bytes(serialize_message(message))))

        for frame in range(FRAMES):
            stamp = (frame + 1) * SECOND
            for side, image, info in zip(("left", "right"), banded_pair(frame), infos(stamp), strict=True):
                message = color(np.ascontiguousarray(image.swapaxes(0, 1)) if vertical else image, stamp)
                if spoil and side == "right" and frame in spoil:
                    message = spoil[frame]
                    message.header = messages.header(stamp, FRAME)
                add(f"/{side}/image_raw", message, stamp)
                if calibrated:
                    add(f"/{side}/camera_info", upright(stamp)[side] if vertical else info, stamp)
    return path


def upright(stamp: int) -> dict[str, Any]:
    """CameraInfo of the rig on its side."""
    geometry = StereoGeometry(FOCAL, (W - 1) / 2, (W - 1) / 2, (H - 1) / 2, baseline_m=BASELINE, axis="vertical")
    return dict(
        zip(("left", "right"), infos_from_geometry(geometry, (H, W), messages.header(stamp, FRAME)), strict=True)
    )


class Replay:
    """A bag stepped through the graph frame by frame; what came of it by stamp and topic."""

    def __init__(
        self, graph: Any, bag: Path, nodes: tuple[str, ...], tmp_path: Path, parameters: str = PARAMETERS
    ) -> None:
        self.graph, self.got = graph, defaultdict[int, dict[str, Any]](dict)
        (tmp_path / "params.yaml").write_text(parameters)
        for name in nodes:
            graph.start(name, "--ros-args", "--params-file", tmp_path / "params.yaml")
        graph.ready(*nodes)
        for topic, kind in HEARD.items():
            graph.bench.outsider.create_subscription(kind, topic, self._keep(topic), 10)
        with open_bag(bag) as reader:
            topics = [topic.name for topic in reader.topics]
        graph.connected(*nodes)
        self.player = graph.start("bag_player_node", bag, "--start-paused", "--wait-for", *topics)
        self.step = graph.stepper()

    def _keep(self, topic: str) -> Any:
        return lambda message: self.got[messages.stamp_ns(message)].update({topic: message})


def offline(bag: Path, parameters: dict[str, Any] = LIMITS) -> dict[int, Products]:
    pipeline = Pipeline(PipelineParams.from_mapping(parameters))
    with open_bag(bag) as reader:
        return {pair.stamp_ns: pipeline(pair) for pair in reader.stereo_pairs()}


def same(got: dict[str, Any], expected: Products) -> None:
    """Bit for bit."""
    disparity = messages.float_image_from_message(got["disparity"].image)
    np.testing.assert_array_equal(disparity, expected.disparity.disparity)
    np.testing.assert_array_equal(messages.image_from_message(got["disparity/status"]), expected.disparity.status)
    cloud = got["points2"] if expected.cloud.metric else got["points_unscaled"]
    points = np.frombuffer(cloud.data, np.float32).reshape(cloud.height, cloud.width, 4)[..., :3]
    np.testing.assert_allclose(points, expected.cloud.points, rtol=1e-6, atol=1e-7)
    assert np.isfinite(points).any()
    if expected.cloud.metric:
        depth = messages.float_image_from_message(got["depth/image_rect"])
        np.testing.assert_allclose(depth, expected.depth.depth, rtol=1e-6)


@pytest.mark.parametrize(
    ("nodes", "rig"),
    [(FOUR, "calibrated"), (FOUR, "vertical"), (FOUR, "uncalibrated"), (("pipeline_node",), "calibrated")],
    ids=["calibrated", "vertical", "uncalibrated", "pipeline_node"],
)
def test_the_graph_makes_what_the_offline_pipeline_makes(
    graph: Any, tmp_path: Path, nodes: tuple[str, ...], rig: str
) -> None:
    bag = write(tmp_path / "bag", calibrated=rig != "uncalibrated", vertical=rig == "vertical")
    expected = offline(bag)
    assert len(expected) == FRAMES
    replay = Replay(graph, bag, nodes, tmp_path)
    metric = {"disparity", "disparity/status", "depth/image_rect", "points2"}
    wanted = {"disparity", "disparity/status", "points_unscaled"} if rig == "uncalibrated" else metric
    for stamp, result in expected.items():
        replay.step()
        graph.spin_until(lambda stamp=stamp: wanted <= set(replay.got[stamp]), f"frame {stamp}")
        same(replay.got[stamp], result)
        assert set(replay.got[stamp]) == wanted
    assert replay.player.wait() == 0
    assert f"sent {FRAMES * (2 if rig == 'uncalibrated' else 4)} messages" in replay.player.output


@pytest.mark.slow
@pytest.mark.skipif(not CANYON.exists(), reason=f"needs {CANYON}")
@pytest.mark.parametrize("turned", [False, True], ids=["as taken", "turned by 90 degrees"])
def test_a_real_pair_without_calibration(graph: Any, tmp_path: Path, turned: bool) -> None:
    """Hazy, uncalibrated, a third of its size: what the nodes send is what offline makes, in no metres."""
    with BagWriter(tmp_path / "bag") as writer:
        for side in ("left", "right"):
            image = cv2.resize(
                read_image(CANYON / f"{side}.png"), None, fx=1 / 3, fy=1 / 3, interpolation=cv2.INTER_AREA
            )
            turn = np.ascontiguousarray(np.rot90(image)) if turned else image
            writer.image(f"/{side}/image_raw", turn, time_ns=SECOND, frame_id=FRAME)
    (expected,) = offline(tmp_path / "bag", {}).values()
    assert expected.disparity.geometry.axis == ("vertical" if turned else "horizontal")
    replay = Replay(graph, tmp_path / "bag", FOUR, tmp_path, "/**: {ros__parameters: {}}")
    replay.step()
    graph.spin_until(lambda: {"disparity", "disparity/status", "points_unscaled"} <= set(replay.got[SECOND]))
    same(replay.got[SECOND], expected)
    assert "depth/image_rect" not in replay.got[SECOND]
    assert "metric scale unknown" in graph.started[3].output


def truncated() -> Image:
    message = color(banded_pair(1)[1], 0)
    message.data = message.data[: len(message.data) // 2]
    return message


def test_a_bad_frame_in_a_bag_costs_that_frame(graph: Any, tmp_path: Path) -> None:
    bag = write(tmp_path / "bag", spoil={1: truncated()})
    expected = offline(bag)
    assert list(expected) == [SECOND, 3 * SECOND]
    replay = Replay(graph, bag, FOUR, tmp_path)
    preprocess = graph.started[0]
    for stamp in (SECOND, 2 * SECOND, 3 * SECOND):
        replay.step()
        if stamp in expected:
            graph.spin_until(lambda stamp=stamp: {"disparity", "points2"} <= set(replay.got[stamp]))
            same(replay.got[stamp], expected[stamp])
        else:
            graph.spin_until(lambda: "frame dropped" in preprocess.output)
    (line,) = [line for line in preprocess.output.splitlines() if "frame dropped" in line]
    assert "right image: image data: expected step x height = 480 x 120 = 57600 bytes, got 28800" in line
    assert 2 * SECOND not in replay.got
    assert all(executable.running for executable in graph.started[:4])


def test_nodes_work_at_the_pace_of_the_bag_and_keep_their_stamps(graph: Any, tmp_path: Path) -> None:
    """Not stepped: whatever comes out carries a stamp of the bag and is right; what was overtaken is missing."""
    bag = write(tmp_path / "bag")
    expected = offline(bag)
    (tmp_path / "params.yaml").write_text(PARAMETERS)
    graph.start("pipeline_node", "--ros-args", "--params-file", tmp_path / "params.yaml")
    heard = graph.bench.listen(PointCloud2, "points2")
    player = graph.start("bag_player_node", bag, "--rate", "4", "--wait-for-subscribers")
    assert player.wait() == 0
    graph.spin_until(lambda: heard and messages.stamp_ns(heard[-1]) == FRAMES * SECOND)
    for message in heard:
        points = np.frombuffer(message.data, np.float32).reshape(H, W, 4)[..., :3]
        np.testing.assert_allclose(points, expected[messages.stamp_ns(message)].cloud.points, rtol=1e-6, atol=1e-7)
