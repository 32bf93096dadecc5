"""What navigation stacks do with our messages, written after their public sources and sharing no code with the node.

Each reader is what its namesake runs before its own work begins: which fields and encodings it takes, which of K and P,
which frame, what it does with NaN. Quality of service is that of its subscription.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, Image, PointCloud2, PointField

Floats = NDArray[np.float64]
Frames = dict[str, tuple[Floats, Floats]]  # rotation and position in the world, by frame

#: rclcpp::SensorDataQoS, nav2::qos::SensorDataQoS(50).
SENSOR_DATA = qos_profile_sensor_data
COSTMAP = QoSProfile(history=HistoryPolicy.KEEP_LAST, depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)
RELIABLE = QoSProfile(depth=10)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def iterate(cloud: PointCloud2, name: str) -> NDArray[np.float32]:
    """sensor_msgs::PointCloud2Iterator<float>: a field by its name, wherever it lies; throws where it is missing."""
    (field,) = [field for field in cloud.fields if field.name == name]
    assert (field.datatype, field.count) == (PointField.FLOAT32, 1)
    assert cloud.row_step == cloud.width * cloud.point_step
    assert len(cloud.data) == cloud.height * cloud.row_step
    assert not cloud.is_bigendian
    bytes_of_points = np.frombuffer(cloud.data, np.uint8).reshape(-1, cloud.point_step)
    return np.ascontiguousarray(bytes_of_points[:, field.offset : field.offset + 4]).view("<f4")[:, 0]


def xyz(cloud: PointCloud2) -> NDArray[np.float32]:
    """(N, 3)."""
    return np.stack([iterate(cloud, axis) for axis in "xyz"], axis=1)


def to_world(points: NDArray[Any], frame_id: str, frames: Frames) -> Floats:
    """tf2::doTransform; an unknown frame is a transform exception."""
    rotation, position = frames[frame_id]
    return points.astype(np.float64) @ rotation.T + position


@dataclass(frozen=True)
class Costmap:
    """nav2_costmap_2d: ObservationBuffer::bufferCloud and the marking of VoxelLayer::updateBounds.

    The buffer first drops what is outside its source's heights, the layer then outside its own; NaN fails every
    comparison of the buffer.
    """

    min_obstacle_height: float = 0.0
    max_obstacle_height: float = 2.0
    obstacle_max_range: float = 2.5
    resolution: float = 0.1

    def obstacles(self, cloud: PointCloud2, frames: Frames) -> Floats:
        """Points in the world that count, (N, 3); each marks its voxel."""
        world = to_world(xyz(cloud), cloud.header.frame_id, frames)
        origin = frames[cloud.header.frame_id][1]
        with np.errstate(invalid="ignore"):
            kept = world[(world[:, 2] <= self.max_obstacle_height) & (world[:, 2] >= self.min_obstacle_height)]
        return kept[((kept - origin) ** 2).sum(axis=1) < self.obstacle_max_range**2]


@dataclass(frozen=True)
class OctomapServer:
    """octomap_server: pcl::fromROSMsg into PointXYZRGB, PassThrough in the world, insertScan."""

    resolution: float = 0.05
    max_range: float = -1.0

    def from_ros_msg(self, cloud: PointCloud2) -> tuple[NDArray[np.float32], NDArray[np.uint8]]:
        """Points and colours. PCL maps a field by name, type and count; its rgb is a float32 of 0x00RRGGBB."""
        points = xyz(cloud)
        packed = iterate(cloud, "rgb").view("<u4")
        colors = np.stack([packed >> shift & 255 for shift in (16, 8, 0)], axis=1).astype(np.uint8)
        # transformPointCloud trusts is_dense and leaves NaN unchecked where it is set.
        assert not cloud.is_dense or np.isfinite(points).all()
        return points, colors

    def ends(self, cloud: PointCloud2, frames: Frames) -> tuple[Floats, NDArray[np.uint8]]:
        """Ends of rays in the world, (N, 3), each of which occupies its cell, and their colours."""
        points, colors = self.from_ros_msg(cloud)
        finite = np.isfinite(points).all(axis=1)  # PassThrough
        world = to_world(points[finite], cloud.header.frame_id, frames)
        distance = np.linalg.norm(world - frames[cloud.header.frame_id][1], axis=1)
        ends = (self.max_range < 0) | (distance <= self.max_range)
        return world[ends], colors[finite][ends]


def depth_pixels(image: Image) -> NDArray[np.float32]:
    """32FC1 as C++ readers take it: the first row at data[0], the next ones `step` bytes on, of the host's order."""
    assert image.encoding == "32FC1"
    assert not image.is_bigendian
    rows = np.frombuffer(image.data, np.uint8).reshape(image.height, image.step)[:, : 4 * image.width]
    return np.ascontiguousarray(rows).view("<f4")


def back_project(depth: NDArray[Any], fx: float, fy: float, cx: float, cy: float) -> Floats:
    v, u = np.indices(depth.shape, dtype=np.float64)
    return np.stack([(u - cx) * depth / fx, (v - cy) * depth / fy, depth], axis=-1)


def depth_image_proc(depth: Image, info: CameraInfo, rgb: Image | None = None) -> tuple[Floats, Any]:
    """PointCloudXyzNode, or PointCloudXyzrgbNode with `rgb`: fx, fy, cx, cy from P; NaN in, NaN out.

    Nothing is published where the sizes differ; where the frames do, a warning is logged.
    """
    fx, cx, fy, cy = info.p[0], info.p[2], info.p[5], info.p[6]
    points = back_project(depth_pixels(depth), fx, fy, cx, cy)
    if rgb is None:
        return points, None
    assert (rgb.width, rgb.height) == (depth.width, depth.height)
    assert rgb.header.frame_id == depth.header.frame_id
    assert rgb.header.stamp == depth.header.stamp == info.header.stamp
    assert rgb.encoding == "bgr8"
    colors = np.frombuffer(rgb.data, np.uint8).reshape(rgb.height, rgb.step)[:, : 3 * rgb.width]
    return points, colors.reshape(rgb.height, rgb.width, 3)[..., ::-1]


def moveit_depth_updater(depth: Image, info: CameraInfo) -> Floats:
    """DepthImageOctomapUpdater: image_transport's exact synchroniser; K; rows without padding; 16UC1 or 32FC1."""
    assert depth.header.stamp == info.header.stamp
    assert depth.step == 4 * depth.width
    assert np.isfinite([info.k[0], info.k[4], info.k[2], info.k[5]]).all()
    inside = back_project(depth_pixels(depth), info.k[0], info.k[4], info.k[2], info.k[5])
    near, far = 0.3, 5.0
    with np.errstate(invalid="ignore"):
        return inside[(inside[..., 2] > near) & (inside[..., 2] < far)]


def rtabmap_rgbd(rgb: Image, depth: Image, info: CameraInfo) -> Floats:
    """rtabmap_sync's rgbd_sync and its camera model: P where it is set; a rectified image has no distortion."""
    assert rgb.encoding in {"8UC1", "mono8", "mono16", "bgr8", "rgb8", "bgra8", "rgba8"}
    assert depth.encoding in {"32FC1", "16UC1", "mono16"}
    assert rgb.header.stamp == depth.header.stamp == info.header.stamp  # approx_sync false
    assert rgb.width % depth.width == 0
    assert rgb.height % depth.height == 0
    assert (info.width, info.height) == (rgb.width, rgb.height)
    assert not any(info.d)
    assert info.p[0] > 0
    values = depth_pixels(depth)
    points = back_project(values, info.p[0], info.p[5], info.p[2], info.p[6])
    return points[np.isfinite(values) & (values > 0)]


def rtabmap_stereo(left: Image, right: Image, left_info: CameraInfo, right_info: CameraInfo) -> float:
    """rtabmap_sync's stereo_sync: two rectified images of one size; the baseline in m out of P[3] of the right one."""
    for image in (left, right):
        assert image.encoding in {"8UC1", "mono8", "mono16", "bgr8", "rgb8", "bgra8", "rgba8"}
    assert left.header.stamp == right.header.stamp == left_info.header.stamp == right_info.header.stamp
    assert (left.width, left.height) == (right.width, right.height) == (left_info.width, left_info.height)
    assert left_info.p[0] == right_info.p[0] > 0
    return float(-right_info.p[3] / right_info.p[0])


def stereo_image_proc(disparity: Any, left: CameraInfo, right: CameraInfo) -> Floats:
    """PointCloudNode: image_geometry's Q out of both P, cv::reprojectImageTo3D with missing values handled.

    OpenCV takes the least disparity of the image for "missing" and puts it at z = 10000, which the node drops.
    """
    fx, fy, cx, cy = left.p[0], left.p[5], left.p[2], left.p[6]
    tx = right.p[3] / right.p[0]
    q = np.array([
        [fy * tx, 0, 0, -fy * cx * tx], [0, fx * tx, 0, -fx * cy * tx],
        [0, 0, 0, fx * fy * tx], [0, 0, -fy, fy * (cx - right.p[2])],
    ])  # fmt: skip
    points = cv2.reprojectImageTo3D(depth_pixels(disparity.image), q, handleMissingValues=True)
    return np.where((points[..., 2:] == 10000) | np.isinf(points[..., 2:]), np.nan, points).astype(np.float64)
