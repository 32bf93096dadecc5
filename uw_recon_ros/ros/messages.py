"""The messages room with ROS's own classes: what the nodes publish and read."""

from __future__ import annotations

from functools import partial

from uw_recon_ros.messages import cameras, clouds, disparities, headers, images, obstacles, odometry
from uw_recon_ros.messages.disparities import disparity_from_message
from uw_recon_ros.messages.headers import received_stamp_ns, stamp_ns
from uw_recon_ros.messages.images import float_image_from_message, image_from_message
from uw_recon_ros.messages.odometry import view_from_odometry
from uw_recon_ros.ros.message_types import MAKE

__all__ = [
    "camera_info_message", "cloud_message", "confidence_message", "depth_messages", "disparity_from_message",
    "disparity_message", "effort_message", "float_image_from_message", "header", "image_from_message", "image_message",
    "odometry_message", "path_message", "range_message", "raw_image_message", "received_stamp_ns", "rectified_infos",
    "scan_message",
    "sigma_message", "stamp_ns", "status_message",
    "surface_message", "time_message", "transform_message", "view_from_odometry",
]  # fmt: skip

time_message = partial(headers.time_message, MAKE)
header = partial(headers.header, MAKE)
image_message = partial(images.image_message, MAKE)
raw_image_message = partial(images.raw_image_message, MAKE)
camera_info_message = partial(cameras.camera_info_message, MAKE)
rectified_infos = partial(cameras.rectified_infos, MAKE)
disparity_message = partial(disparities.disparity_message, MAKE)
status_message = partial(disparities.status_message, MAKE)
sigma_message = partial(disparities.sigma_message, MAKE)
confidence_message = partial(disparities.confidence_message, MAKE)
effort_message = partial(disparities.effort_message, MAKE)
depth_messages = partial(clouds.depth_messages, MAKE)
cloud_message = partial(clouds.cloud_message, MAKE)
surface_message = partial(clouds.surface_message, MAKE)
scan_message = partial(obstacles.scan_message, MAKE)
range_message = partial(obstacles.range_message, MAKE)
odometry_message = partial(odometry.odometry_message, MAKE)
path_message = partial(odometry.path_message, MAKE)
transform_message = partial(odometry.transform_message, MAKE)
