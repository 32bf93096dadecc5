"""The point cloud node, fed by an outsider with no more than a disparity, an image and two camera_infos."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from helpers.ros_bench import (
    BANDS,
    BASELINE,
    FOCAL,
    FRAME,
    HEIGHT,
    WIDTH,
    Bench,
    banded_pair,
    color,
    infos,
    mono,
    texture,
)
from sensor_msgs.msg import CameraInfo, Image, LaserScan, PointCloud2, Range
from stereo_msgs.msg import DisparityImage
from visualization_msgs.msg import Marker

from uw_recon_ros.images import to_gray
from uw_recon_ros.nodes.point_cloud_node import PointCloudNode
from uw_recon_ros.reconstruct.stage import Reconstruct, ReconstructParams
from uw_recon_ros.ros import messages
from uw_recon_ros.ros.geometry import geometry_from_infos
from uw_recon_ros.types import DisparityMap, Status

SECOND = 1_000_000_000
LEFT, _ = banded_pair()
METRIC = {
    "depth/image_rect": Image,
    "depth/sigma": Image,
    "depth/camera_info": CameraInfo,
    "points2": PointCloud2,
    "points2_filtered": PointCloud2,
}


def true_disparity() -> np.ndarray:
    disparity = np.empty((HEIGHT, WIDTH), np.float32)
    for top, bottom, value in BANDS:
        disparity[top:bottom] = value
    disparity[50:60, 70:90] = np.nan
    return disparity


class Matcher:
    """An outsider's stereo matcher."""

    def __init__(
        self, bench: Bench, *, image: str = "image_rect_color", companions: bool = False, images: bool = True
    ) -> None:
        self.bench = bench
        kinds = {
            "disparity": DisparityImage,
            f"rectified/left/{image}": Image,
            "rectified/left/camera_info": CameraInfo,
            "rectified/right/camera_info": CameraInfo,
            **({"disparity/sigma": Image, "disparity/status": Image} if companions else {}),
        }
        self.image = f"rectified/left/{image}"
        self.topics = {topic: bench.talk(kind, topic) for topic, kind in kinds.items()}
        if images:
            bench.listen(PointCloud2, "points_unscaled")  # images are read while something is coloured with them

    def connect(self, unread: str = "") -> None:
        self.bench.connected(*(topic for name, topic in self.topics.items() if name != unread))

    def send(self, stamp_ns: int, *, metric: bool = True, only: str = "", **spoiled: Any) -> None:
        left, right = infos(stamp_ns, metric=metric)
        disparity = messages.image_message(true_disparity(), messages.header(stamp_ns, FRAME))
        everything = {
            "disparity": DisparityImage(
                header=disparity.header, image=disparity, min_disparity=0.0, max_disparity=32.0
            ),
            self.image: color(LEFT, stamp_ns) if self.image.endswith("color") else mono(to_gray(LEFT), stamp_ns),
            "rectified/left/camera_info": left,
            "rectified/right/camera_info": right,
        }
        for topic in filter(lambda topic: topic.startswith(only), everything):
            message = everything[topic]
            self.topics[topic].publish(spoiled.get(topic.rsplit("/", 1)[-1], message))


def xyz(message: PointCloud2) -> np.ndarray:
    table = np.frombuffer(message.data, np.float32).reshape(message.height, message.width, 4)
    return table[..., :3]


def offline(metric: bool = True) -> tuple[Reconstruct, Any]:
    disparity = true_disparity()
    valid = np.isfinite(disparity)
    stage = Reconstruct(ReconstructParams())
    given = DisparityMap(
        disparity, np.where(valid, np.float32(0.5), np.float32(np.nan)),
        np.where(valid, 0, Status.OUT_OF_RANGE).astype(np.uint8), 0, 32, geometry_from_infos(*infos(0, metric=metric)),
        stamp_ns=5 * SECOND, frame_id=FRAME,
    )  # fmt: skip
    return stage, stage.depth(given)


def test_metric_outputs(bench: Bench) -> None:
    bench.start(PointCloudNode)
    heard = {topic: bench.listen(kind, topic) for topic, kind in METRIC.items()}
    unscaled = bench.listen(PointCloud2, "points_unscaled")
    matcher = Matcher(bench)
    matcher.connect()
    matcher.send(5 * SECOND)
    bench.spin_until(lambda: all(heard.values()))
    stage, depth = offline()
    for messages_of_topic in heard.values():
        assert messages.stamp_ns(messages_of_topic[0]) == 5 * SECOND
        assert messages_of_topic[0].header.frame_id == FRAME
    np.testing.assert_array_equal(messages.float_image_from_message(heard["depth/image_rect"][0]), depth.depth)
    np.testing.assert_array_equal(messages.float_image_from_message(heard["depth/sigma"][0]), depth.sigma)
    np.testing.assert_array_equal(xyz(heard["points2"][0]), stage.cloud(depth, LEFT).points)
    np.testing.assert_array_equal(xyz(heard["points2_filtered"][0])[0], stage.filtered_cloud(depth, LEFT).points)
    assert not heard["points2"][0].is_dense
    assert heard["points2_filtered"][0].is_dense
    info = heard["depth/camera_info"][0]
    np.testing.assert_array_equal(info.k.reshape(3, 3), info.p.reshape(3, 4)[:, :3])
    assert unscaled == []


def test_a_matcher_slower_than_a_round_of_a_looped_bag(bench: Bench) -> None:
    """Its disparity comes when the images have been set back already, and again."""
    bench.start(PointCloudNode)
    heard = bench.listen(PointCloud2, "points2")
    matcher = Matcher(bench)
    matcher.connect()
    for second in (3, 1, 4, 2):
        matcher.send(second * SECOND, only="rectified")
    bench.spin_for(0.5)
    for second in (3, 2):
        matcher.send(second * SECOND, only="disparity")
        bench.spin_until(
            lambda s=second: heard and messages.stamp_ns(heard[-1]) == s * SECOND, f"the cloud of {second}"
        )


def test_depth_is_true(bench: Bench) -> None:
    """Against the numbers, not the stage: Z = f B / d in the middle of each band."""
    bench.start(PointCloudNode)
    heard = bench.listen(PointCloud2, "points2")
    matcher = Matcher(bench)
    matcher.connect()
    matcher.send(SECOND)
    bench.spin_until(lambda: heard)
    points = xyz(heard[0])
    for top, bottom, disparity in BANDS:
        v, u = (top + bottom) // 2, 30
        z = FOCAL * BASELINE / disparity
        expected = [(u - (WIDTH - 1) / 2) * z / FOCAL, (v - (HEIGHT - 1) / 2) * z / FOCAL, z]
        np.testing.assert_allclose(points[v, u], expected, rtol=0.02)
    assert np.isnan(points[55, 80]).all()
    colors = np.frombuffer(heard[0].data, np.uint32).reshape(HEIGHT, WIDTH, 4)[20, 30, 3]
    assert [int(colors) >> shift & 255 for shift in (16, 8, 0)] == LEFT[20, 30].tolist()


@pytest.mark.parametrize(("adjusted", "shift"), [(False, 0.0), (True, 4.0)])
def test_principal_points_that_differ(bench: Bench, adjusted: bool, shift: float) -> None:
    """Z = f B / (d + cx_right - cx_left), or f T / d where the disparities are adjusted beforehand."""
    bench.start(PointCloudNode, disparity_adjusted=adjusted)
    heard = bench.listen(Image, "depth/image_rect")
    matcher = Matcher(bench)
    matcher.connect()
    right = infos(SECOND)[1]
    right.p[2] += 4.0
    sent = messages.image_message(true_disparity() + np.float32(shift), messages.header(SECOND, FRAME))
    matcher.topics["rectified/right/camera_info"].publish(right)
    for name in ("disparity", "rectified/left/camera_info", matcher.image):
        message = {
            "disparity": DisparityImage(header=sent.header, image=sent),
            "rectified/left/camera_info": infos(SECOND)[0],
        }.get(name, color(LEFT, SECOND))
        matcher.topics[name].publish(message)
    bench.spin_until(lambda: heard)
    depth = messages.float_image_from_message(heard[0])
    for top, bottom, disparity in BANDS:
        assert depth[(top + bottom) // 2, 30] == pytest.approx(FOCAL * BASELINE / (disparity + 4), rel=0.02)


def test_without_scale_there_are_no_metres(bench: Bench, capfd: pytest.CaptureFixture[str]) -> None:
    node = bench.start(PointCloudNode)
    metric = {topic: bench.listen(kind, topic) for topic, kind in METRIC.items()}
    unscaled, surface = bench.listen(PointCloud2, "points_unscaled"), bench.listen(Marker, "surface")
    matcher = Matcher(bench)
    matcher.connect()
    matcher.send(SECOND, metric=False)
    bench.spin_until(lambda: unscaled and surface)
    assert not any(metric.values())
    stage, depth = offline(metric=False)
    np.testing.assert_array_equal(xyz(unscaled[0]), stage.cloud(depth, LEFT).points)
    assert surface[0].ns == "surface_unscaled"
    assert node.diagnostics.tick("x").level == DiagnosticStatus.WARN
    assert "metric scale unknown" in capfd.readouterr().err


def test_the_surface_is_kept_for_late_listeners(bench: Bench) -> None:
    from rclpy.qos import DurabilityPolicy, QoSProfile

    bench.start(PointCloudNode)
    first = bench.listen(Marker, "surface")
    matcher = Matcher(bench)
    matcher.connect()
    matcher.send(SECOND)
    bench.spin_until(lambda: first)
    assert len(first[0].points) == len(first[0].colors) > 3
    late: list[Marker] = []
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    bench.outsider.create_subscription(Marker, "surface", late.append, latched)
    bench.spin_until(lambda: late)
    assert late[0].points == first[0].points


def test_a_mono_image_will_do_for_texture(bench: Bench) -> None:
    bench.start(PointCloudNode)
    heard = bench.listen(PointCloud2, "points2")
    matcher = Matcher(bench, image="image_rect")
    matcher.connect()
    matcher.send(SECOND)
    bench.spin_until(lambda: heard)
    gray = to_gray(LEFT)[20, 30]
    packed = np.frombuffer(heard[0].data, np.uint32).reshape(HEIGHT, WIDTH, 4)[20, 30, 3]
    assert [int(packed) >> shift & 255 for shift in (16, 8, 0)] == [gray] * 3


def test_depth_needs_no_image_and_reads_none(bench: Bench) -> None:
    bench.start(PointCloudNode)
    depths = bench.listen(Image, "depth/image_rect")
    matcher = Matcher(bench, images=False)
    matcher.connect(unread=matcher.image)
    matcher.send(SECOND)
    bench.spin_until(lambda: depths)
    assert matcher.topics[matcher.image].get_subscription_count() == 0
    clouds = bench.listen(PointCloud2, "points2")
    bench.spin_until(matcher.topics[matcher.image].get_subscription_count)
    matcher.send(2 * SECOND)
    bench.spin_until(lambda: clouds)


def test_what_the_matcher_sees_colours_the_cloud_where_it_is_told_to(bench: Bench) -> None:
    bench.start(PointCloudNode, texture="matching")
    clouds = bench.listen(PointCloud2, "points2")
    matcher = Matcher(bench, image="image_rect")
    picture = bench.talk(Image, "rectified/left/image_rect_color")
    matcher.connect()
    matcher.send(SECOND)
    bench.spin_until(lambda: clouds)
    assert picture.get_subscription_count() == 0


def test_sigma_and_status_are_waited_for_where_they_are_published(bench: Bench) -> None:
    bench.start(PointCloudNode, max_relative_sigma=1.0)
    heard = bench.listen(Image, "depth/sigma")
    matcher = Matcher(bench, companions=True)
    matcher.connect()
    matcher.send(SECOND)
    bench.spin_for(0.3)
    assert heard == []
    sigma = np.where(np.isfinite(true_disparity()), np.float32(0.125), np.float32(np.nan))
    matcher.topics["disparity/sigma"].publish(messages.image_message(sigma, messages.header(SECOND, FRAME)))
    matcher.topics["disparity/status"].publish(mono(np.zeros((HEIGHT, WIDTH), np.uint8), SECOND))
    bench.spin_until(lambda: heard)
    depth_sigma = messages.float_image_from_message(heard[0])
    top, bottom, disparity = BANDS[1]
    z = FOCAL * BASELINE / disparity
    assert depth_sigma[(top + bottom) // 2, 30] == pytest.approx(z * z / (FOCAL * BASELINE) * 0.125, rel=0.02)


def test_a_disparity_that_takes_its_time_finds_its_image(bench: Bench) -> None:
    node = bench.start(PointCloudNode)
    heard = bench.listen(PointCloud2, "points2")
    matcher = Matcher(bench)
    matcher.connect()
    matcher.send(0)
    bench.spin_until(lambda: heard)
    for frame in range(1, 41):
        for topic, message in {
            matcher.image: color(LEFT, frame * SECOND),
            "rectified/left/camera_info": infos(frame * SECOND)[0],
            "rectified/right/camera_info": infos(frame * SECOND)[1],
        }.items():
            matcher.topics[topic].publish(message)
        bench.spin_for(0.01)
    late = messages.image_message(true_disparity(), messages.header(2 * SECOND, FRAME))
    matcher.topics["disparity"].publish(DisparityImage(header=late.header, image=late))
    bench.spin_until(lambda: len(heard) == 2)
    assert messages.stamp_ns(heard[1]) == 2 * SECOND
    assert "ImageError" not in node.diagnostics.drops


def disparity_of(image: Image) -> DisparityImage:
    return DisparityImage(header=image.header, image=image)


def zero_p(side: int) -> CameraInfo:
    info = infos(SECOND)[side]
    info.p.fill(0.0)
    return info


HEAD = messages.header(SECOND, FRAME)
SHORT = messages.image_message(true_disparity(), HEAD)
SHORT.data = SHORT.data[:-4]
BAD = {
    "encoding": ("disparity", disparity_of(mono(np.zeros((HEIGHT, WIDTH), np.uint8), SECOND)), "expected 32FC1"),
    "truncated": ("disparity", disparity_of(SHORT), "bytes, got"),
    "empty": ("disparity", disparity_of(Image(header=HEAD, encoding="32FC1")), "size"),
    "image size": ("image_rect_color", color(texture(10, 20), SECOND), "expected 160x120 px, got 20x10 px"),
    "uncalibrated": ("camera_info", zero_p(0), "expected P with focal lengths > 0"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_messages_cost_the_frame_and_a_line(bench: Bench, name: str, capfd: pytest.CaptureFixture[str]) -> None:
    which, message, words = BAD[name]
    node = bench.start(PointCloudNode)
    heard = bench.listen(PointCloud2, "points2")
    matcher = Matcher(bench)
    matcher.connect()
    matcher.send(SECOND, **{which: message})
    bench.spin_until(lambda: node.diagnostics.drops)
    matcher.send(2 * SECOND)
    bench.spin_until(lambda: heard)
    assert sum(node.diagnostics.drops.values()) == 1
    (line,) = [line for line in capfd.readouterr().err.splitlines() if "frame dropped" in line]
    assert words in line


def test_a_nan_baseline_never_becomes_metres(bench: Bench) -> None:
    bench.start(PointCloudNode)
    depth, unscaled = bench.listen(Image, "depth/image_rect"), bench.listen(PointCloud2, "points_unscaled")
    matcher = Matcher(bench)
    matcher.connect()
    right = infos(SECOND)[1]
    right.p[3] = math.nan
    left = infos(SECOND)[0]
    matcher.topics["rectified/left/camera_info"].publish(left)
    matcher.topics["rectified/right/camera_info"].publish(right)
    matcher.topics["disparity"].publish(disparity_of(messages.image_message(true_disparity(), HEAD)))
    matcher.topics[matcher.image].publish(color(LEFT, SECOND))
    bench.spin_until(lambda: unscaled)
    assert depth == []


def test_an_autopilot_gets_metres_in_its_own_frame(bench: Bench) -> None:
    """Bands of 17, 11 and 5 px: 0.88, 1.36 and 3 m; straight ahead lies the middle one."""
    bench.start(
        PointCloudNode, base_frame="base_link", camera_x_m=0.2, obstacle_field_deg=20.0, obstacle_min_height_m=-0.05,
        obstacle_max_height_m=0.05, obstacle_max_relative_sigma=0.2, range_cone_deg=4.0,
    )  # fmt: skip
    scans, ranges = bench.listen(LaserScan, "obstacles"), bench.listen(Range, "range")
    matcher = Matcher(bench)
    matcher.connect()
    matcher.send(5 * SECOND)
    bench.spin_until(lambda: scans and ranges)
    scan, seen = scans[0], ranges[0]
    for message in (scan, seen):
        assert (message.header.frame_id, messages.stamp_ns(message)) == ("base_link", 5 * SECOND)
    assert len(scan.ranges) == 4
    assert scan.angle_min + 3 * scan.angle_increment == pytest.approx(scan.angle_max, rel=1e-5)
    assert min(scan.ranges) == pytest.approx(FOCAL * BASELINE / 11 + 0.2, rel=0.02)
    assert seen.range == pytest.approx(FOCAL * BASELINE / 11, rel=0.02)
    assert seen.min_range < seen.range < seen.max_range


def test_an_autopilot_gets_nothing_without_its_frame_or_without_metres(bench: Bench) -> None:
    node = bench.start(PointCloudNode)
    scans, clouds = bench.listen(LaserScan, "obstacles"), bench.listen(PointCloud2, "points2")
    unscaled = bench.listen(PointCloud2, "points_unscaled")
    matcher = Matcher(bench)
    matcher.connect()
    matcher.send(5 * SECOND)
    bench.spin_until(lambda: clouds)
    bench.spin_until(lambda: "base_frame" in said(node, "obstacles"))
    assert said(node, "range") == "not published: nobody listens to range"
    matcher.send(6 * SECOND, metric=False)
    bench.spin_until(lambda: unscaled)
    bench.spin_until(lambda: "no metric scale" in said(node, "obstacles"))
    assert scans == []


def said(node: PointCloudNode, key: str) -> str:
    return {pair.key: pair.value for pair in node.diagnostics.tick("x").values}.get(key, "")


def test_what_silences_an_autopilot_is_told_before_a_frame_and_after(bench: Bench) -> None:
    node = bench.start(
        PointCloudNode, base_frame="base_link", obstacle_max_relative_sigma=0.2, range_axis="up", range_cone_deg=1.0,
        stall_warning_s=1.0,
    )  # fmt: skip
    bench.spin_until(lambda: said(node, "obstacles") == "not published: nobody listens to obstacles")
    scans, _ = bench.listen(LaserScan, "obstacles"), bench.listen(Range, "range")
    matcher = Matcher(bench)
    matcher.connect()
    bench.spin_until(lambda: "no pair came through" in said(node, "obstacles"))
    matcher.send(5 * SECOND)
    bench.spin_until(lambda: scans)
    bench.spin_until(lambda: "sectors told" in said(node, "obstacles"))
    assert "nothing in the cone" in said(node, "range")
    bench.spin_until(lambda: "no pair came through" in said(node, "range"))
    node.trigger_deactivate()
    bench.spin_until(lambda: "not active" in said(node, "obstacles"))


def test_open_water_is_all_unknown_and_never_free(bench: Bench) -> None:
    """REP 117: NaN is no measurement; infinity would say that nothing is there."""
    node = bench.start(PointCloudNode, base_frame="base_link")
    scans = bench.listen(LaserScan, "obstacles")
    matcher = Matcher(bench)
    matcher.connect()
    nothing = messages.image_message(np.full((HEIGHT, WIDTH), np.nan, np.float32), messages.header(SECOND, FRAME))
    matcher.send(SECOND, disparity=DisparityImage(header=nothing.header, image=nothing, max_disparity=32.0))
    bench.spin_until(lambda: scans)
    assert np.isnan(scans[0].ranges).all()
    bench.spin_until(lambda: "all sectors unknown: no depth" in said(node, "obstacles"))
