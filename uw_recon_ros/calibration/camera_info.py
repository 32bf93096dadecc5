"""``sensor_msgs/CameraInfo`` -> `CameraModel`."""

from __future__ import annotations

from typing import Any

from uw_recon_ros.calibration.model import as_imaged, make_camera
from uw_recon_ros.types import CameraModel


def camera_from_info(info: Any) -> CameraModel:
    """Convert a ``sensor_msgs/CameraInfo``, rclpy's or rosbags'.

    Raises
    ------
    CalibrationError
        The camera is not calibrated or its numbers make no sense.
    """
    camera = make_camera(
        width=info.width, height=info.height, k=info.k, d=info.d, r=info.r, p=info.p,
        distortion_model=info.distortion_model, frame_id=info.header.frame_id,
    )  # fmt: skip
    roi = getattr(info, "roi", None)
    window = (roi.x_offset, roi.y_offset, roi.width, roi.height) if roi is not None else (0, 0, 0, 0)
    return as_imaged(camera, (getattr(info, "binning_x", 0), getattr(info, "binning_y", 0)), window)
