"""The preprocessing node, and through it what every stage node has from its base class."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from helpers.ros_bench import FRAME, Bench, array, color, texture
from rclpy.parameter import Parameter
from sensor_msgs.msg import CompressedImage, Image

from uw_recon_ros.nodes.preprocess_node import PreprocessNode
from uw_recon_ros.preprocess.stage import Preprocess, PreprocessParams
from uw_recon_ros.ros import messages
from uw_recon_ros.ros.diagnostics import PASSED_OVER, SUPERSEDED
from uw_recon_ros.types import StereoPair

SECOND = 1_000_000_000
LEFT, RIGHT = texture(48, 64, 1), texture(48, 64, 2)


class Cameras:
    """Two cameras publishing to the node under test."""

    def __init__(self, bench: Bench, *, reliable: bool = True) -> None:
        self.left = bench.talk(Image, "left/image_raw", reliable=reliable)
        self.right = bench.talk(Image, "right/image_raw", reliable=reliable)

    def send(self, stamp_ns: int, left: np.ndarray = LEFT, right: np.ndarray = RIGHT, *, apart_ns: int = 0) -> None:
        self.left.publish(color(left, stamp_ns))
        self.right.publish(color(right, stamp_ns + apart_ns, "rov_right_optical_frame"))


def report(heard: list[DiagnosticArray]) -> dict[str, str]:
    return {pair.key: pair.value for pair in heard[-1].status[0].values}


def test_the_node_publishes_what_the_stage_makes(bench: Bench) -> None:
    node = bench.start(PreprocessNode)
    topics = [f"{view}/image_{kind}" for view in ("left", "right") for kind in ("enhanced", "matching")]
    heard = {topic: bench.listen(Image, topic) for topic in topics}
    cameras = Cameras(bench)
    bench.connected(cameras.left, cameras.right)
    cameras.send(5 * SECOND + 7)
    bench.spin_until(lambda: all(heard.values()))
    expected = Preprocess(PreprocessParams())(StereoPair(LEFT, RIGHT))
    for topic, image in zip(
        topics, (expected.left, expected.left_matching, expected.right, expected.right_matching), strict=True
    ):
        (message,) = heard[topic]
        np.testing.assert_array_equal(array(message), image)
        assert messages.stamp_ns(message) == 5 * SECOND + 7
        assert message.header.frame_id == FRAME
    assert heard["left/image_enhanced"][0].encoding == "bgr8"
    assert heard["left/image_matching"][0].encoding == "mono8"
    assert node.diagnostics.drops == {}


def test_cameras_faster_than_asked_for_are_passed_over(bench: Bench) -> None:
    node = bench.start(PreprocessNode, max_rate_hz=0.01)
    heard = bench.listen(Image, "left/image_enhanced")
    cameras = Cameras(bench)
    bench.connected(cameras.left, cameras.right)
    for number in range(1, 4):
        cameras.send(number * SECOND)
    bench.spin_until(lambda: node.diagnostics.drops == {PASSED_OVER: 2} and heard)
    node.set_parameters([Parameter("max_rate_hz", value=0.0)])
    cameras.send(4 * SECOND)
    bench.spin_until(lambda: [messages.stamp_ns(m) for m in heard] == [SECOND, 4 * SECOND])


def test_images_over_max_pixels_are_refused_before_they_are_decoded(bench: Bench) -> None:
    node = bench.start(PreprocessNode, max_pixels=LEFT.shape[0] * LEFT.shape[1] - 1)
    heard = bench.listen(Image, "left/image_enhanced")
    cameras = Cameras(bench)
    bench.connected(cameras.left, cameras.right)
    cameras.send(SECOND)
    bench.spin_until(lambda: node.diagnostics.drops == {"ImageError": 1})
    node.set_parameters([Parameter("max_pixels", value=LEFT.shape[0] * LEFT.shape[1])])
    cameras.send(2 * SECOND)
    bench.spin_until(lambda: [messages.stamp_ns(m) for m in heard] == [2 * SECOND])


def test_it_subscribes_only_while_somebody_listens(bench: Bench) -> None:
    node = bench.start(PreprocessNode)
    cameras = Cameras(bench)
    bench.spin_for(0.7)
    assert cameras.left.get_subscription_count() == 0
    listener = bench.outsider.create_subscription(Image, "left/image_enhanced", lambda m: None, 5)
    bench.connected(cameras.left, cameras.right)
    bench.outsider.destroy_subscription(listener)
    bench.spin_until(lambda: cameras.left.get_subscription_count() == 0)
    assert not node.inputs.active


def test_it_sends_only_what_is_listened_to(bench: Bench) -> None:
    node = bench.start(PreprocessNode)
    heard = bench.listen(Image, "right/image_matching")
    cameras = Cameras(bench)
    bench.connected(cameras.left, cameras.right)
    cameras.send(SECOND)
    bench.spin_until(lambda: heard)
    sent = [pair.key for pair in node.diagnostics.tick("x").values if pair.key.startswith("out ")]
    assert sent == ["out right/image_matching [Hz]"]


def compressed(image: np.ndarray, stamp_ns: int) -> CompressedImage:
    message = CompressedImage(header=messages.header(stamp_ns, FRAME), format="png")
    message.data.frombytes(cv2.imencode(".png", image[..., ::-1])[1].tobytes())
    return message


def test_compressed_images_are_taken_where_nothing_else_is_published(bench: Bench) -> None:
    bench.start(PreprocessNode)
    heard = bench.listen(Image, "left/image_enhanced")
    left = bench.talk(CompressedImage, "left/image_raw/compressed")
    right = bench.talk(Image, "right/image_raw")
    bench.connected(left, right)
    left.publish(compressed(LEFT, SECOND))
    right.publish(color(RIGHT, SECOND))
    bench.spin_until(lambda: heard)
    np.testing.assert_array_equal(array(heard[0]), Preprocess(PreprocessParams())(StereoPair(LEFT, RIGHT)).left)


def test_raw_images_are_preferred_and_a_parameter_says_otherwise(bench: Bench) -> None:
    node = bench.start(PreprocessNode)
    bench.listen(Image, "left/image_enhanced")
    cameras = Cameras(bench)
    others = [bench.talk(CompressedImage, f"{view}/image_raw/compressed") for view in ("left", "right")]
    bench.connected(cameras.left, cameras.right)
    bench.spin_for(0.6)
    assert [p.get_subscription_count() for p in others] == [0, 0]
    assert node.set_parameters([Parameter("image_transport", value="compressed")])[0].successful
    bench.connected(*others)
    bench.spin_until(lambda: cameras.left.get_subscription_count() == 0)


def test_best_effort_cameras_are_heard_after_a_warning(bench: Bench, capfd: pytest.CaptureFixture[str]) -> None:
    bench.start(PreprocessNode)
    heard = bench.listen(Image, "left/image_enhanced")
    cameras = Cameras(bench, reliable=False)
    bench.connected(cameras.left, cameras.right)
    cameras.send(SECOND)
    bench.spin_until(lambda: heard)
    assert "/left/image_raw: a publisher offers best effort only" in capfd.readouterr().err


def test_a_reliability_demanded_by_parameter_is_kept(bench: Bench, capfd: pytest.CaptureFixture[str]) -> None:
    overrides = {f"qos_overrides./{view}/image_raw.subscription.reliability": "reliable" for view in ("left", "right")}
    bench.start(PreprocessNode, **overrides)
    bench.listen(Image, "left/image_enhanced")
    cameras = Cameras(bench, reliable=False)
    bench.spin_for(0.7)
    assert cameras.left.get_subscription_count() == 0
    assert "qos_overrides demands reliable" in capfd.readouterr().err


def test_quality_of_service_by_parameter(bench: Bench) -> None:
    bench.start(
        PreprocessNode, **{
            "qos_overrides./left/image_enhanced.publisher.reliability": "best_effort",
            "qos_overrides./left/image_raw.subscription.depth": 3,
        },
    )  # fmt: skip
    bench.listen(Image, "right/image_enhanced")
    bench.spin_until(lambda: bench.outsider.get_subscriptions_info_by_topic("/left/image_raw"))
    published = bench.outsider.get_publishers_info_by_topic("/left/image_enhanced")[0].qos_profile
    assert published.reliability.name == "BEST_EFFORT"


def test_remaps_and_namespaces_move_every_topic(bench: Bench) -> None:
    bench.start(PreprocessNode, remap={"__ns": "/rov", "left/image_raw": "/port/image"})
    heard = bench.listen(Image, "/rov/left/image_enhanced")
    left, right = bench.talk(Image, "/port/image"), bench.talk(Image, "/rov/right/image_raw")
    bench.connected(left, right)
    left.publish(color(LEFT, SECOND))
    right.publish(color(RIGHT, SECOND))
    bench.spin_until(lambda: heard)


def test_stamps_within_the_tolerance_pair_up(bench: Bench) -> None:
    node = bench.start(PreprocessNode, pair_tolerance_ms=5)
    heard = bench.listen(Image, "right/image_enhanced")
    cameras = Cameras(bench)
    bench.connected(cameras.left, cameras.right)
    cameras.send(SECOND, apart_ns=4_000_000)
    bench.spin_until(lambda: heard)
    assert messages.stamp_ns(heard[0]) == SECOND
    assert heard[0].header.frame_id == FRAME
    cameras.send(2 * SECOND, apart_ns=6_000_000)
    bench.spin_until(lambda: node.diagnostics.drops)
    assert len(heard) == 1


def test_stamps_too_far_apart_are_explained(bench: Bench, capfd: pytest.CaptureFixture[str]) -> None:
    node = bench.start(PreprocessNode, stall_warning_s=0.3)
    bench.listen(Image, "right/image_enhanced")
    cameras = Cameras(bench)
    bench.connected(cameras.left, cameras.right)
    for frame in range(8):
        cameras.send(frame * SECOND, apart_ns=20_000_000)
        bench.spin_for(0.1)
    text = "no stamps pair up: right/image_raw is 20 ms after left/image_raw, pair_tolerance_ms is 1"
    assert text in capfd.readouterr().err
    assert node.diagnostics.tick("x").message == text or "no partner" in str(node.diagnostics.drops)
    cameras.send(100 * SECOND)
    bench.spin_until(lambda: node.diagnostics.tick("x").level == DiagnosticStatus.OK)


def test_silence_is_explained_once(bench: Bench, capfd: pytest.CaptureFixture[str]) -> None:
    node = bench.start(PreprocessNode, stall_warning_s=0.2)
    bench.listen(Image, "right/image_enhanced")
    silent = bench.talk(Image, "right/image_raw")
    bench.connected(silent)
    bench.spin_for(0.8)
    (line,) = [line for line in capfd.readouterr().err.splitlines() if "waiting for" in line]
    assert "/left/image_raw or /left/image_raw/compressed: no publisher" in line
    assert "/right/image_raw: a publisher, but no messages" in line
    assert node.diagnostics.tick("x").level == DiagnosticStatus.WARN
    bench.talk(Image, "left/image_raw").publish(color(LEFT, SECOND))
    silent.publish(color(RIGHT, SECOND))
    bench.spin_until(lambda: node.diagnostics.tick("x").level == DiagnosticStatus.OK)


def broken(**fields: Any) -> Image:
    message = color(LEFT, 0)
    for name, value in fields.items():
        setattr(message, name, value)
    return message


def with_data(data: bytes) -> Image:
    message = Image(height=48, width=64, encoding="bgr8", step=192)
    message.data.frombytes(data)
    return message


BAD_IMAGES = {
    "empty": (Image(), "encoding"),
    "no data": (with_data(b""), "expected step x height = 192 x 48 = 9216 bytes, got 0"),
    "truncated": (with_data(bytes(5000)), "9216 bytes, got 5000"),
    "too much": (with_data(bytes(9217)), "9216 bytes, got 9217"),
    "step too small": (broken(step=10), "step: expected at least 192 bytes"),
    "zero step": (broken(step=0), "step"),
    "encoding": (broken(encoding="yuv_of_the_future"), "yuv_of_the_future"),
    "huge": (broken(height=2**31, width=2**31), "image size"),
    "other size": (color(texture(24, 64), 0), "expected two images of one size, got left 64x24 px colour 8 bits"),
}


@pytest.mark.parametrize("name", BAD_IMAGES)
def test_a_bad_image_costs_its_frame_and_a_line(bench: Bench, name: str, capfd: pytest.CaptureFixture[str]) -> None:
    bad, words = BAD_IMAGES[name]
    node = bench.start(PreprocessNode)
    heard = bench.listen(Image, "left/image_enhanced")
    told = bench.listen(DiagnosticArray, "/diagnostics")
    cameras = Cameras(bench)
    bench.connected(cameras.left, cameras.right)
    cameras.send(SECOND)
    bench.spin_until(lambda: len(heard) == 1)
    bad.header = messages.header(2 * SECOND, FRAME)
    cameras.left.publish(bad)
    cameras.right.publish(color(RIGHT, 2 * SECOND))
    bench.spin_until(lambda: node.diagnostics.drops)
    cameras.send(3 * SECOND)
    bench.spin_until(lambda: len(heard) == 2)
    np.testing.assert_array_equal(array(heard[0]), array(heard[1]))
    lines = [line for line in capfd.readouterr().err.splitlines() if "frame dropped" in line]
    assert len(lines) == 1
    assert words in lines[0]
    bench.spin_until(lambda: told and words in report(told).get("last drop", ""))
    assert report(told)["dropped: ImageError"] == "1"
    assert node.diagnostics.drops == {"ImageError": 1}


def test_the_newest_pair_wins_and_the_overtaken_are_counted(bench: Bench) -> None:
    node = bench.start(PreprocessNode)
    heard = bench.listen(Image, "left/image_enhanced")
    cameras = Cameras(bench)
    bench.connected(cameras.left, cameras.right)
    large = texture(480, 640)
    for frame in range(6):
        cameras.send(frame * SECOND, large, large[:, ::-1])
        bench.spin_for(0.02)
    bench.spin_until(lambda: heard and messages.stamp_ns(heard[-1]) == 5 * SECOND)
    assert node.diagnostics.drops.get(SUPERSEDED, 0) + len(heard) == 6
    stamps = [messages.stamp_ns(message) for message in heard]
    assert stamps == sorted(stamps)


def test_a_parameter_changes_the_stage_and_a_refused_one_does_not(bench: Bench) -> None:
    node = bench.start(PreprocessNode)
    heard = bench.listen(Image, "left/image_enhanced")
    cameras = Cameras(bench)
    bench.connected(cameras.left, cameras.right)
    params = PreprocessParams(homomorphic_filtering=False)
    assert node.set_parameters([Parameter("homomorphic_filtering", value=False)])[0].successful
    assert not node.set_parameters([Parameter("diffusion_rate", value=9.0)])[0].successful
    cameras.send(SECOND)
    bench.spin_until(lambda: heard)
    np.testing.assert_array_equal(array(heard[0]), Preprocess(params)(StereoPair(LEFT, RIGHT)).left)


def test_diagnostics_tell_rates_and_times(bench: Bench) -> None:
    bench.start(PreprocessNode)
    heard = bench.listen(Image, "left/image_enhanced")
    told = bench.listen(DiagnosticArray, "/diagnostics")
    cameras = Cameras(bench)
    bench.connected(cameras.left, cameras.right)
    cameras.send(SECOND)
    bench.spin_until(lambda: heard)
    bench.spin_until(lambda: told and "work [s]" in report(told))
    status, values = told[-1].status[0], report(told)
    assert (status.name, status.level) == ("/preprocess_node", DiagnosticStatus.OK)
    assert {"in left/image_raw [Hz]", "in right/image_raw [Hz]", "out left/image_enhanced [Hz]"} <= set(values)
    assert "dropped" in values
    assert "latency [s]" not in values  # a stamp of 1970 is not of this clock
    now = bench.outsider.get_clock().now().nanoseconds
    cameras.send(now)
    bench.spin_until(lambda: "latency [s]" in report(told))
    assert 0 < float(report(told)["latency [s]"]) < 60
    assert float(values["in left/image_raw [Hz]"]) > 0


def test_stamps_that_jump_back_do_not_stop_the_node(bench: Bench) -> None:
    bench.start(PreprocessNode)
    heard = bench.listen(Image, "left/image_enhanced")
    cameras = Cameras(bench)
    bench.connected(cameras.left, cameras.right)
    for number, stamp in enumerate((100, 101, 1, 2), start=1):
        cameras.send(stamp * SECOND)
        bench.spin_until(lambda number=number: len(heard) == number)


def test_half_a_camera_is_masked_and_reported_by_name(bench: Bench) -> None:
    """And the memory of the frame before is the node's: what stands still in one camera alone is frozen."""
    bench.start(PreprocessNode)
    heard, said = bench.listen(Image, "right/image_matching"), bench.listen(DiagnosticArray, "/diagnostics")
    cameras = Cameras(bench)
    bench.connected(cameras.left, cameras.right)
    half = RIGHT.copy()
    half[24:] = 0
    cameras.send(SECOND, right=half)
    bench.spin_until(lambda: heard)
    assert not array(heard[0])[24:].any()
    assert array(heard[0])[:20].all()
    bench.spin_until(lambda: said and "right camera" in report(said).get("regions", ""))
    assert said[-1].status[0].level == DiagnosticStatus.WARN
    right = texture(48, 64, 5)
    cameras.send(2 * SECOND, texture(48, 64, 3), right)
    bench.spin_until(lambda: len(heard) == 2)
    assert array(heard[1]).all()
    bench.spin_until(lambda: "regions" not in report(said))
    cameras.send(3 * SECOND, texture(48, 64, 4), right)
    bench.spin_until(lambda: len(heard) == 3)
    assert not array(heard[2]).any()
    bench.spin_until(lambda: "frame before" in report(said).get("regions", ""))
