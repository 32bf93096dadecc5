"""The rectification node: calibrations, their absence, and what goes downstream."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray
from helpers.ros_bench import (
    BASELINE,
    FRAME,
    HEIGHT,
    WIDTH,
    Bench,
    array,
    banded_pair,
    calibration,
    color,
    infos,
    mono,
    stamped,
)
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, Image

from uw_recon_ros.images import to_gray
from uw_recon_ros.nodes.rectify_node import RectifyNode, came_rectified_to
from uw_recon_ros.rectify.stage import Rectify, RectifyParams
from uw_recon_ros.rectify.tracker import RigTracker
from uw_recon_ros.ros import messages
from uw_recon_ros.ros.geometry import geometry_from_infos
from uw_recon_ros.types import EnhancedPair, RectifiedPair

SECOND = 1_000_000_000
LEFT, RIGHT = banded_pair()
MATCHING = 255 - to_gray(LEFT), 255 - to_gray(RIGHT)
OUTPUTS = {
    **{
        f"rectified/{camera}/{kind}": Image
        for camera in ("left", "right")
        for kind in ("image_rect", "image_rect_color")
    },
    **{f"rectified/{camera}/camera_info": CameraInfo for camera in ("left", "right")},
}


class Upstream:
    """What the preprocessing node and the cameras publish."""

    def __init__(self, bench: Bench, *, infos: bool = True, matching: bool = False) -> None:
        self.bench = bench
        kinds = (
            [("image_enhanced", Image)] + [("image_matching", Image)] * matching + [("camera_info", CameraInfo)] * infos
        )
        self.topics = {
            f"{camera}/{kind}": bench.talk(t, f"{camera}/{kind}") for kind, t in kinds for camera in ("left", "right")
        }

    def connect(self, *unread: str) -> None:
        self.bench.connected(*(topic for name, topic in self.topics.items() if not name.endswith(unread or "!")))

    def images(self, stamp_ns: int, left: np.ndarray = LEFT, right: np.ndarray = RIGHT) -> None:
        self.topics["left/image_enhanced"].publish(color(left, stamp_ns))
        self.topics["right/image_enhanced"].publish(color(right, stamp_ns, "rov_right"))

    def matching(self, stamp_ns: int) -> None:
        left, right = (mono(image, stamp_ns) for image in MATCHING)
        self.send(left__image_matching=left, right__image_matching=right)

    def send(self, **messages: Any) -> None:
        for name, message in messages.items():
            self.topics[name.replace("__", "/")].publish(message)

    def calibrate(self, stamp_ns: int, node: Any = None) -> None:
        left, right = infos(stamp_ns)
        self.send(left__camera_info=left, right__camera_info=right)
        if node is not None:  # the next images shall find it there
            latest = node.inputs.assembler.latest
            names = ("left_info", "right_info")
            self.bench.spin_until(lambda: all(messages.stamp_ns(latest[name]) == stamp_ns for name in names))


def offline(use: str = "auto", matching: tuple[np.ndarray, np.ndarray] | None = None) -> RectifiedPair:
    params = RectifyParams(calibration_use=use)
    gray = matching or (to_gray(LEFT), to_gray(RIGHT))
    pair = EnhancedPair(LEFT, RIGHT, *gray, 5 * SECOND, FRAME, calibration() if use != "ignore" else None)
    return Rectify(params)(pair, RigTracker(params).update(pair))


def test_a_calibrated_pair(bench: Bench) -> None:
    bench.start(RectifyNode)
    heard = {topic: bench.listen(kind, topic) for topic, kind in OUTPUTS.items()}
    upstream = Upstream(bench)
    upstream.connect()
    upstream.calibrate(SECOND)
    upstream.images(5 * SECOND)
    bench.spin_until(lambda: all(heard.values()))
    expected = offline()
    for topic, image in {
        "rectified/left/image_rect_color": expected.left,
        "rectified/right/image_rect_color": expected.right,
        "rectified/left/image_rect": expected.left_matching,
        "rectified/right/image_rect": expected.right_matching,
    }.items():
        np.testing.assert_array_equal(array(heard[topic][0]), image)
    for messages_of_topic in heard.values():
        assert messages.stamp_ns(messages_of_topic[0]) == 5 * SECOND
        assert messages_of_topic[0].header.frame_id == FRAME
    left, right = (heard[f"rectified/{camera}/camera_info"][0] for camera in ("left", "right"))
    assert right.p[3] == pytest.approx(-BASELINE * right.p[0])
    assert (left.width, left.height) == (expected.left.shape[1], expected.left.shape[0])
    geometry = geometry_from_infos(left, right)
    assert geometry.metric
    assert geometry.offset_px == pytest.approx(expected.geometry.offset_px)


@pytest.mark.parametrize(("told", "expected"), [("auto", "yes"), ("no", "no")])
def test_rectified_cameras_are_known_by_the_topic_remapped_to(bench: Bench, told: str, expected: str) -> None:
    remap = {f"{side}/image_raw": f"/stereo/{side}/image_rect_color" for side in ("left", "right")}
    node = bench.start(RectifyNode, remap=remap, images_rectified=told)
    heard = bench.listen(CameraInfo, "rectified/left/camera_info")
    upstream = Upstream(bench)
    upstream.connect()
    left, right = infos(SECOND)
    for info in (left, right):  # of the raw camera: rectified by it, the images would be other ones
        info.k[0], info.k[4], info.d = 1.2 * info.k[0], 1.2 * info.k[4], [-0.1, 0.0, 0.0, 0.0, 0.0]
    right.d[0] = -0.11
    upstream.send(left__camera_info=left, right__camera_info=right)
    upstream.images(5 * SECOND)
    bench.spin_until(lambda: heard)
    assert came_rectified_to(node, RectifyParams(images_rectified=told)) == (expected == "yes",) * 2
    as_it_came = (heard[0].width, heard[0].height) == (WIDTH, HEIGHT)
    assert as_it_came == (expected == "yes")
    if as_it_came:
        np.testing.assert_allclose(heard[0].p, left.p)


def test_the_matching_images_are_taken_where_they_are_published(bench: Bench) -> None:
    bench.start(RectifyNode)
    heard = {topic: bench.listen(Image, topic) for topic in OUTPUTS if "image" in topic}
    upstream = Upstream(bench, matching=True)
    upstream.connect()
    upstream.calibrate(SECOND)
    upstream.images(5 * SECOND)
    bench.spin_for(0.3)
    assert not any(heard.values())  # waits for what has a publisher
    upstream.matching(5 * SECOND)
    bench.spin_until(lambda: all(heard.values()))
    expected = offline(matching=MATCHING)
    np.testing.assert_array_equal(array(heard["rectified/left/image_rect"][0]), expected.left_matching)
    np.testing.assert_array_equal(array(heard["rectified/right/image_rect_color"][0]), expected.right)


def test_pictures_are_read_only_while_somebody_reads_rectified_ones(bench: Bench) -> None:
    bench.start(RectifyNode)
    heard = bench.listen(Image, "rectified/left/image_rect")
    upstream = Upstream(bench, matching=True)
    upstream.connect("image_enhanced")
    upstream.calibrate(SECOND)
    upstream.matching(5 * SECOND)
    bench.spin_until(lambda: heard)
    np.testing.assert_array_equal(array(heard[0]), offline(matching=MATCHING).left_matching)
    readers = {side: upstream.topics[f"{side}/image_enhanced"].get_subscription_count for side in ("left", "right")}
    assert {side: count() for side, count in readers.items()} == {"left": 0, "right": 0}
    pictures = bench.listen(Image, "rectified/left/image_rect_color")
    bench.spin_until(lambda: readers["left"]())
    upstream.images(6 * SECOND)
    upstream.matching(6 * SECOND)
    bench.spin_until(lambda: pictures)
    np.testing.assert_array_equal(array(pictures[0]), offline(matching=MATCHING).left)
    assert readers["right"]() == 0


def test_the_first_pair_waits_for_a_calibration_that_will_come(bench: Bench) -> None:
    node = bench.start(RectifyNode)
    heard = bench.listen(CameraInfo, "rectified/right/camera_info")
    upstream = Upstream(bench)
    upstream.connect()
    upstream.images(5 * SECOND)
    bench.spin_for(0.3)
    assert heard == []
    upstream.calibrate(5 * SECOND)
    bench.spin_until(lambda: heard)
    assert heard[0].p[3] < 0
    assert node.diagnostics.drops == {}


def test_without_camera_info_the_scale_is_unknown(bench: Bench) -> None:
    bench.start(RectifyNode)
    heard = bench.listen(CameraInfo, "rectified/right/camera_info")
    told = bench.listen(DiagnosticArray, "/diagnostics")
    upstream = Upstream(bench, infos=False)
    upstream.connect()
    upstream.images(SECOND)
    bench.spin_until(lambda: heard)
    assert math.isnan(heard[0].p[3])
    bench.spin_until(lambda: told and any(v.key == "scale" and v.value == "unknown" for v in told[-1].status[0].values))


def test_a_zero_camera_matrix_is_no_calibration_and_said(bench: Bench, capfd: pytest.CaptureFixture[str]) -> None:
    node = bench.start(RectifyNode)
    heard = bench.listen(CameraInfo, "rectified/right/camera_info")
    upstream = Upstream(bench)
    upstream.connect()
    upstream.send(
        left__camera_info=stamped(CameraInfo(width=WIDTH, height=HEIGHT), SECOND),
        right__camera_info=stamped(CameraInfo(width=WIDTH, height=HEIGHT), SECOND),
    )
    upstream.images(SECOND)
    bench.spin_until(lambda: heard)
    assert math.isnan(heard[0].p[3])
    assert "left/camera_info and right/camera_info: K is zero (not calibrated)" in capfd.readouterr().err
    upstream.calibrate(2 * SECOND, node)  # and a calibration that comes later is taken
    upstream.images(2 * SECOND)
    bench.spin_until(lambda: len(heard) == 2)
    assert heard[1].p[3] < 0


def test_calibrations_can_be_ignored(bench: Bench) -> None:
    bench.start(RectifyNode, calibration_use="ignore")
    heard = bench.listen(CameraInfo, "rectified/right/camera_info")
    upstream = Upstream(bench)
    images = [upstream.topics[f"{camera}/image_enhanced"] for camera in ("left", "right")]
    bench.connected(*images)
    assert upstream.topics["left/camera_info"].get_subscription_count() == 0
    upstream.images(SECOND)
    bench.spin_until(lambda: heard)
    assert math.isnan(heard[0].p[3])


def test_a_required_calibration_that_is_missing_costs_the_frame(bench: Bench) -> None:
    node = bench.start(RectifyNode, calibration_use="require")
    bench.listen(CameraInfo, "rectified/right/camera_info")
    upstream = Upstream(bench, infos=False)
    upstream.connect()
    upstream.images(SECOND)
    bench.spin_until(lambda: node.diagnostics.drops)
    assert node.diagnostics.drops == {"CalibrationError": 1}
    assert "calibration_use = require" in node.diagnostics.tick("x").message


def spoiled(**fields: Any) -> CameraInfo:
    info = infos(0)[1]
    for name, value in fields.items():
        setattr(info, name, value)
    return info


BAD_INFOS = {
    "nan": (spoiled(k=np.full(9, math.nan)), "K: expected 9 finite numbers"),
    "another size": (spoiled(width=2 * WIDTH), "expected 160x120 px as the images"),
    "exchanged": (spoiled(p=np.array([150.0, 0, 79.5, 15, 0, 150, 59.5, 0, 0, 0, 1, 0])), "swap"),
    "unknown distortion": (spoiled(distortion_model="magic", d=[1.0, 2.0]), "magic"),
    "other focal length": (spoiled(p=np.array([170.0, 0, 79.5, -15, 0, 150, 59.5, 0, 0, 0, 1, 0])), "150 and"),
}


@pytest.mark.parametrize("name", BAD_INFOS)
def test_a_bad_calibration_costs_its_frames_and_a_line(
    bench: Bench, name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    bad, words = BAD_INFOS[name]
    node = bench.start(RectifyNode)
    heard = bench.listen(Image, "rectified/left/image_rect")
    upstream = Upstream(bench)
    upstream.connect()
    upstream.send(left__camera_info=infos(SECOND)[0], right__camera_info=stamped(bad, SECOND))
    upstream.images(SECOND)
    bench.spin_until(lambda: node.diagnostics.drops)
    upstream.calibrate(2 * SECOND, node)
    upstream.images(2 * SECOND)
    bench.spin_until(lambda: heard)
    assert node.diagnostics.drops == {"CalibrationError": 1}
    (line,) = [line for line in capfd.readouterr().err.splitlines() if "frame dropped" in line]
    assert words in line


def test_exchanged_cameras_are_noticed(bench: Bench) -> None:
    node = bench.start(RectifyNode)
    bench.listen(Image, "rectified/left/image_rect")
    upstream = Upstream(bench)
    upstream.connect()
    upstream.calibrate(SECOND)
    upstream.images(SECOND, RIGHT, LEFT)
    bench.spin_until(lambda: node.diagnostics.drops)
    assert node.diagnostics.drops == {"EstimationError": 1}
    assert "left and right images are swapped" in node.diagnostics.tick("x").message


def test_images_without_texture_cost_the_frame(bench: Bench) -> None:
    node = bench.start(RectifyNode)
    bench.listen(Image, "rectified/left/image_rect")
    upstream = Upstream(bench, infos=False)
    upstream.connect()
    upstream.images(SECOND, np.full_like(LEFT, 90), np.full_like(LEFT, 90))
    bench.spin_until(lambda: node.diagnostics.drops)
    assert node.diagnostics.drops == {"EstimationError": 1}


def test_matching_images_of_another_size_are_refused(bench: Bench) -> None:
    node = bench.start(RectifyNode)
    bench.listen(Image, "rectified/left/image_rect_color"), bench.listen(Image, "rectified/right/image_rect_color")
    upstream = Upstream(bench, infos=False, matching=True)
    upstream.connect()
    small = to_gray(LEFT)[::2, ::2]
    upstream.images(SECOND)
    upstream.send(left__image_matching=mono(small, SECOND), right__image_matching=mono(small[::-1], SECOND))
    bench.spin_until(lambda: node.diagnostics.drops)
    assert "matching images: expected 160x120 px, got 80x60 px" in node.diagnostics.tick("x").message


def test_the_rig_is_remembered_until_its_parameters_change(bench: Bench) -> None:
    node = bench.start(RectifyNode)
    before = node.stage.rig
    assert node.set_parameters([Parameter("pair_tolerance_ms", value=3.0)])[0].successful
    assert node.stage.rig is before
    assert node.set_parameters([Parameter("rectify_seed", value=1)])[0].successful
    assert node.stage.rig is not before
