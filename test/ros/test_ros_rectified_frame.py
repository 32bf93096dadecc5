"""The rectified frame: its name, its transform, and how tf is told."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message

from uw_recon_ros.reconstruct.triangulation import points_from_depth
from uw_recon_ros.rigid import quaternion
from uw_recon_ros.ros.rectified_frame import rectifying_transform, rotation_deg
from uw_recon_ros.types import StereoGeometry, named_frame, optical_frame, rectified_frame

TURNS = [(0.0, 0.0, 0.0), (0.01, -0.02, 0.005), (math.pi, 0.0, 0.0), (0.0, math.pi, 0.0), (0.0, 0.0, -3.1), (1, 2, 0.5)]


def geometry(turn: tuple[float, float, float]) -> StereoGeometry:
    rotation = cv2.Rodrigues(np.array(turn, np.float64))[0]
    return StereoGeometry(300.0, 40.0, 40.0, 30.0, baseline_m=0.1,
                          rect_from_raw_left=tuple(map(tuple, rotation.tolist())))  # fmt: skip


def rotated(q: tuple[float, float, float, float], point: np.ndarray) -> np.ndarray:
    """q p q*, written out."""
    axis, w = np.array(q[:3]), q[3]
    return point + 2 * np.cross(axis, np.cross(axis, point) + w * point)


@pytest.mark.parametrize("turn", TURNS)
def test_the_quaternion_rotates_as_the_matrix_does(turn: tuple[float, float, float]) -> None:
    rotation = cv2.Rodrigues(np.array(turn, np.float64))[0]
    q = quaternion(rotation)
    assert np.linalg.norm(q) == pytest.approx(1.0)
    assert q[3] >= 0
    for point in np.eye(3):
        np.testing.assert_allclose(rotated(q, point), rotation @ point, atol=1e-9)


@pytest.mark.parametrize("turn", TURNS[:2])
def test_the_transform_takes_points_of_the_depth_image_to_the_cloud(turn: tuple[float, float, float]) -> None:
    """A point computed from depth and K alone, put through tf, is the point of the cloud."""
    rig = geometry(turn)
    depth = np.random.default_rng(0).uniform(1, 3, (60, 80)).astype(np.float32)
    message = rectifying_transform(rig, 1_500_000_000, "rov_left_optical_frame")
    q = message.transform.rotation
    seen = points_from_depth(depth, rig, "rectified")[20, 50].astype(np.float64)
    expected = points_from_depth(depth, rig, "optical")[20, 50]
    np.testing.assert_allclose(rotated((q.x, q.y, q.z, q.w), seen), expected, rtol=1e-5)
    assert message.header.frame_id == "rov_left_optical_frame"
    assert message.child_frame_id == "rov_left_optical_frame_rectified"
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (1, 500_000_000)
    t = message.transform.translation
    assert (t.x, t.y, t.z) == (0, 0, 0)


def test_the_transform_travels() -> None:
    message = rectifying_transform(geometry((0.1, 0.2, 0.3)), 0, "left_rectified")
    assert deserialize_message(serialize_message(message), type(message)) == message
    assert message.header.frame_id == "left"


@pytest.mark.parametrize("degrees", [0.0, 0.7, 90.0])
def test_the_angle(degrees: float) -> None:
    assert rotation_deg(geometry((0.0, math.radians(degrees), 0.0))) == pytest.approx(degrees, abs=1e-5)


def test_names() -> None:
    assert rectified_frame("cam") == "cam_rectified" == rectified_frame("cam_rectified")
    assert optical_frame("cam_rectified") == "cam" == optical_frame("cam")
    assert (named_frame("cam", "optical"), named_frame("cam", "rectified")) == ("cam", "cam_rectified")
