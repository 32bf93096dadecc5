"""The rectified geometry must survive its trip through two CameraInfo."""

from __future__ import annotations

import math

import numpy as np
import pytest
from helpers.ros_bench import infos_from_geometry
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import CameraInfo

from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.messages.cameras import ideal_camera
from uw_recon_ros.ros.geometry import (
    check_size,
    geometry_from_infos,
    window_from_info,
)
from uw_recon_ros.ros.messages import camera_info_message, header
from uw_recon_ros.types import StereoGeometry, Window

HEAD = header(5_000_000_001, "left_optical_frame")
ANGLE = 0.1
ROTATION = ((math.cos(ANGLE), 0.0, math.sin(ANGLE)), (0.0, 1.0, 0.0), (-math.sin(ANGLE), 0.0, math.cos(ANGLE)))


def over_the_wire(info: CameraInfo) -> CameraInfo:
    return deserialize_message(serialize_message(info), CameraInfo)


def trip(geometry: StereoGeometry) -> StereoGeometry:
    return geometry_from_infos(*(over_the_wire(info) for info in infos_from_geometry(geometry, (640, 480), HEAD)))


def test_horizontal_pair_by_the_book() -> None:
    geometry = StereoGeometry(500.0, 320.0, 330.0, 240.0, baseline_m=0.12, rect_from_raw_left=ROTATION)
    left, right = infos_from_geometry(geometry, (640, 480), HEAD)
    assert list(left.p) == [500, 0, 320, 0, 0, 500, 240, 0, 0, 0, 1, 0]
    assert list(right.p) == [500, 0, 330, -60, 0, 500, 240, 0, 0, 0, 1, 0]
    assert list(left.k) == [500, 0, 320, 0, 500, 240, 0, 0, 1]
    assert list(left.d) == [0.0] * 5
    np.testing.assert_array_equal(left.r.reshape(3, 3), ROTATION)
    np.testing.assert_array_equal(right.r.reshape(3, 3), np.eye(3))
    assert (left.width, left.height, left.header.frame_id) == (640, 480, "left_optical_frame")


def test_vertical_pair_by_the_book() -> None:
    geometry = StereoGeometry(500.0, 240.0, 250.0, 320.0, baseline_m=0.12, axis="vertical", focal_across_px=510.0)
    left, right = infos_from_geometry(geometry, (640, 480), HEAD)
    assert list(left.p) == [510, 0, 320, 0, 0, 500, 240, 0, 0, 0, 1, 0]
    assert list(right.p) == [510, 0, 320, 0, 0, 500, 250, -60, 0, 0, 1, 0]


def test_a_point_projects_into_both_views_with_the_disparity_of_its_depth() -> None:
    geometry = StereoGeometry(500.0, 320.0, 330.0, 240.0, baseline_m=0.12)
    left, right = (info.p.reshape(3, 4) for info in infos_from_geometry(geometry, (640, 480), HEAD))
    point = np.array([0.3, -0.2, 1.7, 1.0])
    (u_left, v_left), (u_right, v_right) = ((p @ point)[:2] / (p @ point)[2] for p in (left, right))
    assert v_left == pytest.approx(v_right)
    depth = geometry.depth_from_disparity(np.array([u_left - u_right], np.float32))
    assert depth[0] == pytest.approx(1.7, rel=1e-5)


@given(
    axis=st.sampled_from(["horizontal", "vertical"]),
    metric=st.booleans(),
    sign=st.sampled_from([1, -1]),
    numbers=st.tuples(*[st.floats(100, 2000)] * 5),
    baseline=st.floats(0.01, 3.0),
)
@settings(max_examples=60)
def test_geometry_survives(axis: str, metric: bool, sign: int, numbers: tuple[float, ...], baseline: float) -> None:
    if axis == "horizontal" and metric:
        sign = 1
    focal, across, cx_left, cx_right, cy = numbers
    sent = StereoGeometry(
        focal, cx_left, cx_right, cy, baseline_m=sign * baseline if metric else None, axis=axis,  # type: ignore[arg-type]
        baseline_sign=sign, focal_across_px=across, rect_from_raw_left=ROTATION,
    )  # fmt: skip
    got = trip(sent)
    assert (got.axis, got.metric, got.baseline_sign) == (sent.axis, sent.metric, sent.baseline_sign)
    assert got.focal_times_baseline == pytest.approx(sent.focal_times_baseline, rel=1e-12)
    assert (got.cx_left, got.cx_right, got.cy, got.focal_across_px) == (cx_left, cx_right, cy, across)
    np.testing.assert_allclose(got.rect_from_raw_left, sent.rect_from_raw_left, atol=1e-15)


def test_unknown_baseline_is_nan_where_the_baseline_would_be() -> None:
    for axis, place in (("horizontal", 3), ("vertical", 7)):
        _, right = infos_from_geometry(StereoGeometry(1.0, 0.0, 0.0, 0.0, axis=axis), (8, 8), HEAD)  # type: ignore[arg-type]
        assert np.flatnonzero(np.isnan(right.p)).tolist() == [place]


def test_zeros_and_a_plain_nan_of_an_outsider_mean_unknown() -> None:
    left, right = infos_from_geometry(StereoGeometry(9.0, 1.0, 1.0, 1.0, baseline_m=0.1), (8, 8), HEAD)
    right.p[3] = 0.0
    got = geometry_from_infos(left, right)
    assert (got.metric, got.axis, got.baseline_sign) == (False, "horizontal", 1)
    right.p[7] = math.nan
    got = geometry_from_infos(left, right)
    assert (got.metric, got.axis, got.baseline_sign) == (False, "vertical", 1)


def test_a_left_camera_with_an_offset_of_its_own() -> None:
    """Some drivers put the origin between the cameras."""
    left, right = infos_from_geometry(StereoGeometry(100.0, 1.0, 1.0, 1.0, baseline_m=0.1), (8, 8), HEAD)
    left.p[3], right.p[3] = 5.0, -5.0
    assert geometry_from_infos(left, right).baseline_m == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda left, right: left.p.fill(0.0), "left camera_info: expected P with focal lengths > 0"),
        (lambda left, right: right.p.put(0, 90.0), "equal focal lengths in P, got 100 and 90"),
        (lambda left, right: right.p.put(6, 9.0), "got 1 and 9 px"),
        (lambda left, right: right.p.put(3, 10.0), "swapped"),
        (lambda left, right: right.p.put(7, -3.0), "a horizontal or a vertical baseline"),
        (lambda left, right: right.p.put(3, -math.inf), "a horizontal or a vertical baseline"),
        (lambda left, right: left.p.put(2, math.nan), "P with focal lengths"),
        (lambda left, right: left.r.put(0, 7.0), "rotation"),
    ],
)
def test_what_is_wrong_is_said(spoil: object, words: str) -> None:
    left, right = infos_from_geometry(StereoGeometry(100.0, 1.0, 1.0, 1.0, baseline_m=0.1), (8, 8), HEAD)
    spoil(left, right)  # type: ignore[operator]
    with pytest.raises(CalibrationError, match=words):
        geometry_from_infos(left, right)


def test_a_rotation_left_at_zero_is_none() -> None:
    left, right = infos_from_geometry(StereoGeometry(100.0, 1.0, 1.0, 1.0, baseline_m=0.1), (8, 8), HEAD)
    left.r.fill(0.0)
    np.testing.assert_array_equal(geometry_from_infos(left, right).rect_from_raw_left, np.eye(3))


def test_depth_camera_is_ideal() -> None:
    info = camera_info_message(ideal_camera(np.array([[5.0, 0, 2], [0, 6, 3], [0, 0, 1]]), (4, 6)), HEAD)
    np.testing.assert_array_equal(info.p.reshape(3, 4)[:, :3], info.k.reshape(3, 3))
    np.testing.assert_array_equal(info.r.reshape(3, 3), np.eye(3))
    assert not np.any(info.d)


def test_window_and_size() -> None:
    info = camera_info_message(ideal_camera(np.eye(3), (40, 30)), HEAD)
    assert window_from_info(info) is None
    info = camera_info_message(ideal_camera(np.eye(3), (40, 30)), HEAD, Window(3, 4, 20, 10))
    assert window_from_info(over_the_wire(info)) == Window(3, 4, 20, 10)
    check_size(info, (30, 40, 3))
    with pytest.raises(CalibrationError, match="expected the image's size 30x40, got 40x30"):
        check_size(info, (40, 30))
