"""Images that come rectified: known by the topic's name, described by P alone, never rectified twice."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from uw_recon_ros.bags.stereo import StereoTopics
from uw_recon_ros.calibration import make_camera
from uw_recon_ros.calibration.judge import judge_calibration
from uw_recon_ros.calibration.rectified import as_rectified, named_rectified, rectified_by_name
from uw_recon_ros.recordings.pair_index import Rigs
from uw_recon_ros.rectify import RectifyParams
from uw_recon_ros.rectify.tracker import RigTracker
from uw_recon_ros.types import CameraModel, EnhancedPair, StereoCalibration

K = np.array([[180.0, 0, 160], [0, 180, 120], [0, 0, 1]])


def camera(tx: float) -> CameraModel:
    """A raw camera whose rectified image differs much from it."""
    r = np.array([[0.9998, 0.02, 0], [-0.02, 0.9998, 0], [0, 0, 1]])
    p = np.array([[170.0, 0, 155, tx], [0, 170, 118, 0], [0, 0, 1, 0]])
    return make_camera(width=320, height=240, k=K, d=[-0.2, 0.05, 0.001, tx * 1e-5, 0], r=r, p=p)


RIG = StereoCalibration(camera(0.0), camera(-20.0))


@pytest.mark.parametrize(
    "topic",
    [
        "/left/image_rect", "/left/image_rect_color", "/camera/infra1/image_rect_raw", "left/image_rectified",
        "/left/image_rect/compressed", "/zed/left/color/rect/image", "/left/rect_image",
    ],
)  # fmt: skip
def test_names_that_say_so(topic: str) -> None:
    assert named_rectified(topic)


@pytest.mark.parametrize(
    "topic",
    [
        "/directdrive/left/image_raw", "/debug_rig/left/image_raw", "/left/image_direct", "/left/image_unrectified",
        "/rectified_dives/left/image_raw", "/left/image_raw/compressed", "",
    ],
)  # fmt: skip
def test_names_that_do_not(topic: str) -> None:
    assert not named_rectified(topic)


@pytest.mark.parametrize(("told", "expected"), [("auto", True), ("yes", True), ("no", False)])
def test_what_is_told_wins_over_the_name(told: str, expected: bool) -> None:
    assert rectified_by_name(told, "/left/image_rect") == expected
    assert rectified_by_name(told, "/left/image_raw") == (told == "yes")


def test_p_alone_describes_a_rectified_image() -> None:
    found = as_rectified(RIG.right)
    np.testing.assert_array_equal(found.k, RIG.right.p[:, :3])
    np.testing.assert_array_equal(found.p, RIG.right.p)
    assert not found.d.any()
    np.testing.assert_array_equal(found.r, np.eye(3))
    assert judge_calibration(StereoCalibration(as_rectified(RIG.left), found)).baseline_m == pytest.approx(20 / 170)


def pair() -> EnhancedPair:
    random = np.random.default_rng(3)
    left = random.integers(1, 255, (240, 320), np.uint8)
    right = np.roll(left, -12, axis=1)  # in front of the rig
    colors = [np.repeat(gray[..., None], 3, 2) for gray in (left, right)]
    return EnhancedPair(*colors, left, right, calibration=RIG)


@pytest.mark.parametrize(("told", "method"), [("yes", "given"), ("no", "calibrated"), ("auto", "calibrated")])
def test_files_are_rectified_unless_told(told: str, method: str) -> None:
    found = RigTracker(RectifyParams(images_rectified=told)).update(pair())
    assert found.quality.method == method
    assert (found.left_map is None) == (told == "yes")
    if told == "yes":
        assert (found.geometry.focal_px, found.geometry.cx_left, found.geometry.cy) == (170, 155, 118)


def test_a_survey_knows_a_rig_by_how_its_images_came() -> None:
    rigs = Rigs()
    topics = StereoTopics("/left/image_rect", "/right/image_rect", None, None)
    numbers = [rigs.index(RIG, topics.rectified(told)) for told in ("auto", "no", "yes")]
    assert numbers == [0, 1, 0]
    assert not rigs.calibrations[0].left.d.any()
    assert rigs.calibrations[1].left.d.any()
    given = Rigs(replace(RIG))
    given.index(None, topics.rectified("auto"))
    assert not given.calibrations[0].left.d.any()
