"""Clouds and surfaces against bytes written down by hand."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointField
from visualization_msgs.msg import Marker

from uw_recon_ros.messages.clouds import pack_rgb
from uw_recon_ros.ros.messages import cloud_message, depth_messages, surface_message
from uw_recon_ros.types import DepthMap, PointCloud, StereoGeometry, Surface

POINTS = np.array([[[1.0, 2.0, 3.0], [np.nan] * 3]], np.float32)
COLORS = np.array([[[10, 20, 30], [40, 50, 60]]], np.uint8)
CLOUD = PointCloud(POINTS, COLORS, metric=True, stamp_ns=2_000_000_001, frame_id="left_optical_frame")


def test_a_point_is_sixteen_bytes() -> None:
    data = cloud_message(CLOUD).data.tobytes()
    assert data[:12] == struct.pack("=3f", 1.0, 2.0, 3.0)
    assert struct.unpack("=I", data[12:16]) == (0x000A141E,)
    assert len(data) == 32


def test_an_organised_cloud_keeps_its_shape_and_its_holes() -> None:
    message = cloud_message(CLOUD)
    assert (message.width, message.height, message.point_step, message.row_step) == (2, 1, 16, 32)
    assert not message.is_dense
    assert [(f.name, f.offset, f.datatype, f.count) for f in message.fields] == [
        (name, 4 * i, PointField.FLOAT32, 1) for i, name in enumerate(["x", "y", "z", "rgb"])
    ]
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (2, 1)
    assert message.header.frame_id == "left_optical_frame"
    assert np.isnan(np.frombuffer(message.data, np.float32).reshape(2, 4)[1, :3]).all()


def test_a_thinned_cloud_is_dense_and_one_row() -> None:
    message = cloud_message(PointCloud(POINTS[0, :1], COLORS[0, :1], metric=True))
    assert (message.width, message.height, message.is_dense) == (1, 1, True)


def test_an_empty_cloud_is_a_message_too() -> None:
    message = cloud_message(PointCloud(np.empty((0, 3), np.float32), np.empty((0, 3), np.uint8)))
    assert (message.width, message.height, len(message.data)) == (0, 1, 0)


def test_packed_colours_are_rgb_from_the_top() -> None:
    assert pack_rgb(np.array([[255, 128, 1]], np.uint8)).view(np.uint32)[0] == 0xFF8001


def test_depth_comes_with_an_ideal_camera() -> None:
    geometry = StereoGeometry(500.0, 1.0, 3.0, 0.5, baseline_m=0.1)
    depth = DepthMap(np.full((2, 3), 1.5, np.float32), np.full((2, 3), 0.1, np.float32),
                     np.zeros((2, 3), np.uint8), geometry, 7, "left")  # fmt: skip
    image, sigma, info = depth_messages(depth)
    assert np.frombuffer(image.data, np.float32).tolist() == [1.5] * 6
    assert sigma.encoding == image.encoding == "32FC1"
    assert list(info.p) == [500, 0, 1, 0, 0, 500, 0.5, 0, 0, 0, 1, 0]
    np.testing.assert_array_equal(info.r.reshape(3, 3), np.eye(3))
    assert info.header == image.header == sigma.header


def surface(faces: list[list[int]], *, metric: bool = True) -> Surface:
    vertices = np.array([[0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 2]], np.float32)
    colors = np.array([[255, 0, 0], [0, 255, 0], [0, 0, 255], [51, 102, 204]], np.uint8)
    return Surface(
        vertices, np.array(faces, np.int32).reshape(-1, 3), vertices, vertices[:, :2], colors,
        np.zeros((2, 2, 3), np.uint8), metric, 9, "left",
    )  # fmt: skip


def test_a_marker_lists_corners() -> None:
    marker = deserialize_message(serialize_message(surface_message(surface([[0, 1, 2], [2, 1, 3]]))), Marker)
    assert (marker.type, marker.action, marker.ns) == (Marker.TRIANGLE_LIST, Marker.ADD, "surface")
    assert [(p.x, p.y, p.z) for p in marker.points] == [
        (0, 0, 1), (1, 0, 1), (0, 1, 1), (0, 1, 1), (1, 0, 1), (1, 1, 2),
    ]  # fmt: skip
    last = marker.colors[-1]
    assert (last.r, last.g, last.b, last.a) == pytest.approx((0.2, 0.4, 0.8, 1.0))
    assert (marker.scale.x, marker.scale.y, marker.scale.z, marker.pose.orientation.w) == (1, 1, 1, 1)


def test_a_surface_without_scale_says_so() -> None:
    assert surface_message(surface([[0, 1, 2]], metric=False)).ns == "surface_unscaled"


def test_an_empty_surface_takes_the_last_one_away() -> None:
    marker = surface_message(surface([]))
    assert (marker.action, len(marker.points)) == (Marker.DELETE, 0)
