"""The disparity node, fed by an outsider with no more than two images and two camera_infos."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from helpers.ros_bench import (
    BANDS,
    BASELINE,
    FOCAL,
    FRAME,
    Bench,
    array,
    banded_pair,
    color,
    infos,
    infos_from_geometry,
    mono,
    texture,
)
from rclpy.parameter import Parameter
from sensor_msgs.msg import CameraInfo, Image
from stereo_msgs.msg import DisparityImage

from uw_recon_ros.images import to_gray
from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.nodes.disparity_node import DisparityNode
from uw_recon_ros.ros import messages
from uw_recon_ros.ros.geometry import geometry_from_infos
from uw_recon_ros.types import DisparityMap, RectificationQuality, RectifiedPair, StereoGeometry

SECOND = 1_000_000_000
LEFT, RIGHT = (to_gray(image) for image in banded_pair())
LIMITS = {"min_disparity": 0, "max_disparity": 24}


class Rectifier:
    """An outsider that publishes rectified images, as image_proc does."""

    def __init__(self, bench: Bench) -> None:
        kinds = {"image_rect": Image, "camera_info": CameraInfo}
        self.bench = bench
        self.topics = {
            f"{side}_{name}": bench.talk(kind, f"rectified/{side}/{name}")
            for name, kind in kinds.items()
            for side in ("left", "right")
        }

    def connect(self) -> None:
        self.bench.connected(*self.topics.values())

    def send(self, stamp_ns: int, **spoiled: Any) -> None:
        left, right = infos(stamp_ns)
        everything = {
            "left_image_rect": mono(LEFT, stamp_ns), "right_image_rect": mono(RIGHT, stamp_ns),
            "left_camera_info": left, "right_camera_info": right,
        }  # fmt: skip
        for name, message in {**everything, **spoiled}.items():
            self.topics[name].publish(message)


def offline(
    left: np.ndarray = LEFT, right: np.ndarray = RIGHT, geometry: StereoGeometry | None = None, effort: str = "balanced"
) -> DisparityMap:
    geometry = geometry or geometry_from_infos(*infos(0))
    colors = [np.repeat(image[..., None], 3, axis=2) for image in (left, right)]
    pair = RectifiedPair(*colors, left, right, geometry, RectificationQuality("given"))
    return Match(MatchParams(effort=effort, **LIMITS))(pair)


def test_disparity_and_its_companions(bench: Bench) -> None:
    bench.start(DisparityNode, **LIMITS)
    heard = {topic: bench.listen(kind, topic) for topic, kind in
             {"disparity": DisparityImage, "disparity/status": Image, "disparity/sigma": Image,
              "disparity/confidence": Image, "disparity/effort": DiagnosticArray}.items()}  # fmt: skip
    rectifier = Rectifier(bench)
    rectifier.connect()
    rectifier.send(5 * SECOND)
    bench.spin_until(lambda: all(heard.values()))
    expected = offline()
    message = heard["disparity"][0]
    np.testing.assert_array_equal(messages.float_image_from_message(message.image), expected.disparity)
    np.testing.assert_array_equal(array(heard["disparity/status"][0]), expected.status)
    np.testing.assert_array_equal(messages.float_image_from_message(heard["disparity/sigma"][0]), expected.sigma)
    np.testing.assert_array_equal(
        messages.float_image_from_message(heard["disparity/confidence"][0]), expected.confidence
    )
    for each in (
        message,
        message.image,
        *(heard[f"disparity/{name}"][0] for name in ("status", "sigma", "confidence", "effort")),
    ):
        assert (messages.stamp_ns(each), each.header.frame_id) == (5 * SECOND, FRAME)
    assert heard["disparity/effort"][0].status[0].message == "balanced"
    assert (message.f, message.t) == (pytest.approx(FOCAL), pytest.approx(BASELINE))
    assert (message.min_disparity, message.max_disparity) == (0.0, 24.0)


def test_disparity_is_true(bench: Bench) -> None:
    bench.start(DisparityNode, **LIMITS)
    heard = bench.listen(DisparityImage, "disparity")
    rectifier = Rectifier(bench)
    rectifier.connect()
    rectifier.send(SECOND)
    bench.spin_until(lambda: heard)
    got = messages.float_image_from_message(heard[0].image)
    for top, bottom, disparity in BANDS:
        band = got[top + 4 : bottom - 4, 30:-5]
        assert np.nanmedian(band) == pytest.approx(disparity, abs=0.25)
        assert (np.abs(band - disparity) < 1).mean() > 0.9


def test_a_vertical_pair(bench: Bench) -> None:
    """The same scene lying on its side: rows and columns exchanged, P[7] instead of P[3]."""
    bench.start(DisparityNode, **LIMITS)
    heard = bench.listen(DisparityImage, "disparity")
    rectifier = Rectifier(bench)
    rectifier.connect()
    height, width = LEFT.T.shape
    geometry = StereoGeometry(FOCAL, 79.5, 79.5, 59.5, baseline_m=BASELINE, axis="vertical")
    left, right = infos_from_geometry(geometry, (width, height), messages.header(SECOND, FRAME))
    images = {f"{side}_image_rect": mono(np.ascontiguousarray(image.T), SECOND)
              for side, image in (("left", LEFT), ("right", RIGHT))}  # fmt: skip
    rectifier.send(SECOND, left_camera_info=left, right_camera_info=right, **images)
    bench.spin_until(lambda: heard)
    np.testing.assert_array_equal(messages.float_image_from_message(heard[0].image).T, offline().disparity)
    assert heard[0].t == pytest.approx(BASELINE)


def test_a_color_image_is_taken_by_its_luma(bench: Bench) -> None:
    bench.start(DisparityNode, **LIMITS)
    heard = bench.listen(DisparityImage, "disparity")
    rectifier = Rectifier(bench)
    rectifier.connect()
    left, right = banded_pair()
    rectifier.send(SECOND, left_image_rect=color(left, SECOND), right_image_rect=color(right, SECOND))
    bench.spin_until(lambda: heard)
    np.testing.assert_array_equal(messages.float_image_from_message(heard[0].image), offline().disparity)


def no_calibration() -> CameraInfo:
    info = infos(SECOND)[0]
    info.p.fill(0.0)
    return info


HEAD = messages.header(SECOND, FRAME)
DEEP = messages.raw_image_message(LEFT.astype(np.uint16), "mono16", HEAD)
DEEP_RIGHT = messages.raw_image_message(RIGHT.astype(np.uint16), "mono16", HEAD)
BAD = {
    "camera_info of another size": (
        {"left_camera_info": CameraInfo(header=HEAD, width=9, height=9)},
        "the image's size 160x120, got 9x9",
    ),
    "no calibration": ({"left_camera_info": no_calibration()}, "focal lengths > 0"),
    "images of two sizes": (
        {"right_image_rect": mono(RIGHT[:60], SECOND)},
        "got left 160x120 px mono 8 bits",
    ),
    "16 bits": ({"left_image_rect": DEEP, "right_image_rect": DEEP_RIGHT}, "expected 8 bits a channel, got uint16"),
}


@pytest.mark.parametrize("name", BAD)
def test_bad_messages_cost_the_frame_and_a_line(bench: Bench, name: str, capfd: pytest.CaptureFixture[str]) -> None:
    spoiled, words = BAD[name]
    node = bench.start(DisparityNode, **LIMITS)
    heard = bench.listen(DisparityImage, "disparity")
    rectifier = Rectifier(bench)
    rectifier.connect()
    rectifier.send(SECOND, **spoiled)
    bench.spin_until(lambda: node.diagnostics.drops)
    rectifier.send(2 * SECOND)
    bench.spin_until(lambda: heard)
    assert sum(node.diagnostics.drops.values()) == 1
    (line,) = [line for line in capfd.readouterr().err.splitlines() if "frame dropped" in line]
    assert words in line


def test_no_disparity_range_in_the_images_and_none_given(bench: Bench) -> None:
    node = bench.start(DisparityNode)
    bench.listen(DisparityImage, "disparity")
    rectifier = Rectifier(bench)
    rectifier.connect()
    blank = np.full_like(LEFT, 100)
    rectifier.send(SECOND, left_image_rect=mono(blank, SECOND), right_image_rect=mono(blank, SECOND))
    bench.spin_until(lambda: node.diagnostics.drops)
    assert node.diagnostics.drops == {"EstimationError": 1}


def test_parameters_that_contradict_each_other_are_refused(bench: Bench) -> None:
    node = bench.start(DisparityNode, **LIMITS)
    result = node.set_parameters([Parameter("min_disparity", value=99)])[0]
    assert not result.successful
    assert "max_disparity: expected at least min_disparity = 99 px, got 24" in result.reason


def test_adjusted_disparities_on_the_wire(bench: Bench) -> None:
    bench.start(DisparityNode, disparity_adjusted=True, **LIMITS)
    heard = bench.listen(DisparityImage, "disparity")
    rectifier = Rectifier(bench)
    rectifier.connect()
    right = infos(SECOND)[1]
    right.p[2] += 4.0
    rectifier.send(SECOND, right_camera_info=right)
    bench.spin_until(lambda: heard)
    geometry = geometry_from_infos(infos(0)[0], right)
    expected = offline(geometry=geometry).disparity + 4
    np.testing.assert_array_equal(messages.float_image_from_message(heard[0].image), expected)


def test_texture_alone_is_not_enough(bench: Bench) -> None:
    """Two unrelated images: a result or an error, but the node lives."""
    node = bench.start(DisparityNode)
    heard = bench.listen(DisparityImage, "disparity")
    rectifier = Rectifier(bench)
    rectifier.connect()
    unrelated = to_gray(texture(*LEFT.shape, seed=99))
    rectifier.send(SECOND, right_image_rect=mono(unrelated, SECOND))
    bench.spin_until(lambda: heard or node.diagnostics.drops)
    heard.clear()
    rectifier.send(2 * SECOND)
    bench.spin_until(lambda: heard)


def said(node: DisparityNode) -> dict[str, str]:
    return {pair.key: pair.value for pair in node.diagnostics.tick("x").values}


def test_a_rate_out_of_reach(bench: Bench) -> None:
    """The least effort is spent, and that it does not suffice is said; without a target, all of it is spent."""
    node = bench.start(DisparityNode, target_rate_hz=1000.0, **LIMITS)
    heard = bench.listen(DisparityImage, "disparity")
    rectifier = Rectifier(bench)
    rectifier.connect()
    for frame in range(1, 5):
        rectifier.send(frame * SECOND)
        bench.spin_until(lambda n=frame: len(heard) == n)
    bench.spin_until(lambda: "rate" in said(node))
    assert said(node)["effort"] == "navigation"
    assert said(node)["target [Hz]"] == "1000"
    assert float(said(node)["possible [Hz]"]) < 1000
    assert node.diagnostics.tick("x").message == "target_rate_hz: 1000 Hz missed even with effort navigation"
    for message in heard:
        disparity = messages.float_image_from_message(message.image)
        np.testing.assert_array_equal(disparity, offline(effort="navigation").disparity)
    heard.clear()
    assert node.set_parameters([Parameter("target_rate_hz", value=0.0)])[0].successful
    rectifier.send(9 * SECOND)
    bench.spin_until(lambda: heard and "effort" in said(node))
    np.testing.assert_array_equal(messages.float_image_from_message(heard[0].image), offline().disparity)
    bench.spin_until(lambda: said(node)["effort"] == "balanced")
    assert "rate" not in said(node)
    assert "target [Hz]" not in said(node)


def test_a_rate_within_reach(bench: Bench) -> None:
    """It begins with the least effort and climbs to the one asked for, no further."""
    node = bench.start(DisparityNode, target_rate_hz=0.01, **LIMITS)
    heard = bench.listen(DisparityImage, "disparity")
    rectifier = Rectifier(bench)
    rectifier.connect()
    efforts = []
    for frame in range(1, 26):
        rectifier.send(frame * SECOND)
        bench.spin_until(lambda n=frame: len(heard) == n)
        bench.spin_until(lambda: "effort" in said(node))
        efforts.append(said(node)["effort"])
    assert (efforts[0], efforts[-1], set(efforts)) == ("navigation", "balanced", {"navigation", "balanced"})
    first, last = (messages.float_image_from_message(heard[i].image) for i in (0, -1))
    np.testing.assert_array_equal(first, offline(effort="navigation").disparity)
    np.testing.assert_array_equal(last, offline().disparity)


def test_a_camera_that_shows_nothing_is_no_disparity(bench: Bench) -> None:
    """It used to be 90 % dense, and working."""
    node = bench.start(DisparityNode, **LIMITS)
    heard, said = bench.listen(DisparityImage, "disparity"), bench.listen(DiagnosticArray, "/diagnostics")
    rectifier = Rectifier(bench)
    rectifier.connect()
    rectifier.send(SECOND, right_image_rect=mono(np.zeros_like(RIGHT), SECOND))
    bench.spin_until(lambda: node.diagnostics.drops == {"EstimationError": 1})
    bench.spin_until(lambda: any(m.status[0].level == DiagnosticStatus.ERROR for m in said))
    worst = next(m.status[0] for m in said if m.status[0].level == DiagnosticStatus.ERROR)
    assert worst.message.startswith("right image: expected a scene")
    half = RIGHT.copy()
    half[len(half) // 2 :] = 0
    rectifier.send(2 * SECOND, right_image_rect=mono(half, 2 * SECOND))
    bench.spin_until(lambda: heard)
    found = messages.float_image_from_message(heard[0].image)
    np.testing.assert_array_equal(found, offline(right=half).disparity)
    assert not np.isfinite(found[len(half) // 2 + 1 :]).any()
    assert np.isfinite(found[: len(half) // 2]).mean() > 0.5
