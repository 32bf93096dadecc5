"""The four stages in one process, and as four nodes: the same messages."""

from __future__ import annotations

import struct
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from helpers.ros_bench import (
    AUTOPILOT,
    BANDS,
    BASELINE,
    FOCAL,
    FRAME,
    HEIGHT,
    WIDTH,
    Bench,
    banded_pair,
    calibration,
    color,
    infos,
    infos_from_geometry,
)
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from uw_recon_ros.nodes.disparity_node import DisparityNode
from uw_recon_ros.nodes.pipeline_node import OUTPUTS, PipelineNode
from uw_recon_ros.nodes.point_cloud_node import PointCloudNode
from uw_recon_ros.nodes.preprocess_node import PreprocessNode
from uw_recon_ros.nodes.rectify_node import RectifyNode
from uw_recon_ros.pipeline import Pipeline, PipelineParams
from uw_recon_ros.ros import messages
from uw_recon_ros.types import StereoGeometry, StereoPair

SECOND = 1_000_000_000
LEFT, RIGHT = banded_pair()
LIMITS = {"min_disparity": 0, "max_disparity": 24}
FOUR = (PreprocessNode, RectifyNode, DisparityNode, PointCloudNode)


class Rig:
    """Two calibrated cameras."""

    def __init__(self, bench: Bench, *, calibrated: bool = True) -> None:
        self.calibrated = calibrated
        self.images = {side: bench.talk(Image, f"{side}/image_raw") for side in ("left", "right")}
        self.infos = (
            {side: bench.talk(CameraInfo, f"{side}/camera_info") for side in ("left", "right")} if calibrated else {}
        )

    def connect(self, bench: Bench) -> None:
        bench.connected(*self.images.values(), *self.infos.values())

    def send(self, stamp_ns: int) -> None:
        for side, image, info in zip(("left", "right"), (LEFT, RIGHT), infos(stamp_ns), strict=True):
            self.images[side].publish(color(image, stamp_ns))
            if self.calibrated:
                self.infos[side].publish(info)


def listen_to_all(bench: Bench) -> dict[str, list[Any]]:
    return {output.topic: bench.listen(output.type, output.topic) for output in OUTPUTS}


def content(value: Any) -> Any:
    """A message as nested tuples, arrays as bytes: NaN equals NaN, padding counts for nothing."""
    if hasattr(value, "get_fields_and_field_types"):
        return tuple((name, content(getattr(value, name))) for name in value.get_fields_and_field_types())
    if hasattr(value, "tobytes"):
        return value.tobytes()
    if isinstance(value, float):
        return struct.pack("d", value)
    return [content(each) for each in value] if isinstance(value, list) else value


def run(bench: Bench, nodes: tuple[Any, ...], *, calibrated: bool) -> dict[str, Any]:
    for node in nodes:
        limits = LIMITS if node in (DisparityNode, PipelineNode) else {}
        limits = limits | (AUTOPILOT if node in (PointCloudNode, PipelineNode) else {})
        bench.start(node, **limits)
    heard = listen_to_all(bench)
    rig = Rig(bench, calibrated=calibrated)
    rig.connect(bench)
    rig.send(7 * SECOND)
    unscaled = {"points_unscaled"}
    metric = {
        "depth/image_rect",
        "depth/sigma",
        "depth/camera_info",
        "points2",
        "points2_filtered",
        "obstacles",
        "range",
    }
    expected = set(heard) - (unscaled if calibrated else metric)
    bench.spin_until(lambda: all(heard[topic] for topic in expected), "all outputs")
    bench.spin_for(0.1)
    assert {topic for topic, got in heard.items() if got} == expected
    return {topic: content(got[0]) for topic, got in heard.items() if got}


@pytest.mark.parametrize("calibrated", [True, False])
def test_one_process_and_four_nodes_send_the_same(calibrated: bool) -> None:
    results = []
    for nodes in (FOUR, (PipelineNode,)):
        bench = Bench()
        try:
            results.append(run(bench, nodes, calibrated=calibrated))
        finally:
            bench.close()
    four, one = results
    assert set(four) == set(one)
    for topic, sent in four.items():
        assert one[topic] == sent, topic


def test_it_is_what_the_offline_pipeline_makes(bench: Bench) -> None:
    bench.start(PipelineNode, **LIMITS)
    heard = listen_to_all(bench)
    rig = Rig(bench)
    rig.connect(bench)
    rig.send(7 * SECOND)
    bench.spin_until(lambda: all(heard[topic] for topic in ("disparity", "points2", "depth/sigma", "surface")))
    pair = StereoPair(LEFT, RIGHT, 7 * SECOND, FRAME, calibration())
    result = Pipeline(PipelineParams.from_mapping(LIMITS))(pair)
    np.testing.assert_array_equal(
        messages.float_image_from_message(heard["disparity"][0].image), result.disparity.disparity
    )
    points = np.frombuffer(heard["points2"][0].data, np.float32).reshape(HEIGHT, WIDTH, 4)[..., :3]
    np.testing.assert_array_equal(points, result.cloud.points)
    assert len(heard["surface"][0].points) == 3 * len(result.surface.faces)


@pytest.mark.parametrize(
    ("topic", "untouched"),
    [("left/image_enhanced", {"rectification", "density"}), ("rectified/left/image_rect", {"density"})],
)
def test_it_goes_no_further_than_somebody_listens(bench: Bench, topic: str, untouched: set[str]) -> None:
    node = bench.start(PipelineNode, **LIMITS)
    heard = bench.listen(Image, topic)
    rig = Rig(bench)
    rig.connect(bench)
    rig.send(SECOND)
    seen: set[str] = set()

    def done() -> bool:
        seen.update(pair.key for pair in node.diagnostics.tick("x").values)
        return "work [s]" in seen

    bench.spin_until(lambda: done() and heard)
    assert not seen & untouched


def test_a_rig_already_known_outlives_a_change_of_the_matcher(bench: Bench) -> None:
    node = bench.start(PipelineNode, **LIMITS)
    before = node.stage
    assert node.set_parameters([Parameter("kz2_sweeps", value=2)])[0].successful
    assert node.stage.match.params.kz2_sweeps == 2
    assert node.stage.rectify is before.rectify
    assert node.set_parameters([Parameter("lock_frames", value=3)])[0].successful
    assert node.stage.rectify is not before.rectify


def test_it_knows_the_parameters_of_all_stages(bench: Bench) -> None:
    node = bench.start(PipelineNode)
    names = (
        "homomorphic_cutoff",
        "lock_frames",
        "max_disparity",
        "cloud_voxel",
        "pair_tolerance_ms",
        "image_transport",
    )
    assert all(node.has_parameter(name) for name in names)


AGE = 600


def test_diagnostics_say_everything_one_number_a_key(bench: Bench) -> None:
    """Rates in and out, drops by reason, work, latency since the stamp, state and effort: for people and programs."""
    bench.start(PipelineNode, effort="navigation", **LIMITS)
    told = bench.listen(DiagnosticArray, "/diagnostics")
    heard = bench.listen(PointCloud2, "points2")
    rig = Rig(bench)
    rig.connect(bench)

    def values() -> dict[str, str]:
        return {pair.key: pair.value for pair in told[-1].status[0].values} if told else {}

    stamp = bench.outsider.get_clock().now().nanoseconds - AGE * SECOND  # on the way to us, far longer than any work
    rig.send(stamp)
    bench.spin_until(lambda: heard)
    rig.images["left"].publish(color(LEFT, stamp + SECOND))  # its partner is lost
    rig.send(stamp + AGE * SECOND)
    bench.spin_until(lambda: len(heard) == 2)
    bench.spin_until(lambda: "dropped: no partner within tolerance" in values() and "latency [s]" in values())
    said = values()
    expected = {
        "in left/image_raw [Hz]", "in right/image_raw [Hz]", "in left/camera_info [Hz]", "in groups [Hz]", "done [Hz]",
        "out points2 [Hz]", "dropped [Hz]", "dropped", "dropped: no partner within tolerance",
        *(f"{what}{spread} [s]" for what in ("work", "latency") for spread in ("", " p95", " max")),
    }  # fmt: skip
    assert expected <= set(said)
    assert (said["state"], said["warm_up"], said["effort"]) == ("active", "done", "navigation")
    numbers = {key: float(value) for key, value in said.items() if key.endswith(("[Hz]", "[s]")) or "dropped" in key}
    assert numbers["latency max [s]"] > AGE > numbers["work max [s]"] > 0
    assert numbers["dropped"] == numbers["dropped: no partner within tolerance"] == 1
    assert said["obstacles"] == "not published: nobody listens to obstacles"


@pytest.mark.parametrize("nodes", [FOUR, (PipelineNode,)])
def test_cameras_that_change_their_resolution_midway(bench: Bench, nodes: tuple[Any, ...]) -> None:
    """Twice as large and small again: right depths of each size, and nothing to start anew."""
    for node in nodes:
        bench.start(
            node, **({"min_disparity": 0, "max_disparity": 48} if node in (DisparityNode, PipelineNode) else {})
        )
    heard = bench.listen(Image, "depth/image_rect")
    rig = Rig(bench)
    rig.connect(bench)
    stamp = 0
    for times in (1, 2, 1):
        width, height = times * WIDTH, times * HEIGHT
        geometry = StereoGeometry(
            times * FOCAL, (width - 1) / 2, (width - 1) / 2, (height - 1) / 2, baseline_m=BASELINE
        )
        heard.clear()
        while not [depth for depth in heard if depth.width == width]:
            stamp += SECOND
            notes = infos_from_geometry(geometry, (width, height), messages.header(stamp, FRAME))
            for side, image, info in zip(("left", "right"), (LEFT, RIGHT), notes, strict=True):
                rig.infos[side].publish(info)
                rig.images[side].publish(color(np.kron(image, np.ones((times, times, 1), np.uint8)), stamp))
            bench.spin_for(0.3)
        depth = messages.float_image_from_message(next(depth for depth in heard if depth.width == width))
        top, bottom, disparity = BANDS[1]
        found = np.nanmedian(depth[times * (top + 5) : times * (bottom - 5), times * 40 : times * (WIDTH - 20)])
        assert found == pytest.approx(FOCAL * BASELINE / disparity, rel=0.03)
