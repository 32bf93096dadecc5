"""Cameras and rectified geometry -> ``CameraInfo``.

What travels of a rectified pair: ``P[:3, :3]`` is the rectified intrinsic matrix, ``P[3] = -fx B`` of the right camera
(``P[7] = -fy B`` in a vertical rig) the baseline, and ``R`` of the left camera the rotation from its unrotated frame to
the rectified one. ``K = P[:3, :3]`` and ``D = 0``, since the images are rectified already. ``roi`` is the part of the
image that shows something, where that is not all of it.

An unknown baseline is NaN at its place, ``P[3]`` or ``P[7]``, which thereby still tells the rig's axis; the NaN's sign
bit is set where the second camera lies on the other side (`StereoGeometry.baseline_sign`). Whoever computes metres from
it gets NaN, the one spelling of "invalid".
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from uw_recon_ros.messages.factory import MessageFactory
from uw_recon_ros.messages.headers import header
from uw_recon_ros.types import CameraModel, Matrix, RectifiedPair, StereoGeometry, Window

CAMERA_INFO = "sensor_msgs/msg/CameraInfo"


def camera_info_message(make: MessageFactory, camera: CameraModel, head: Any, window: Window | None = None) -> Any:
    """CameraInfo of a camera; its region of interest is the window, where there is one."""
    seen = window or Window(0, 0, 0, 0)
    region = make(
        "sensor_msgs/msg/RegionOfInterest", x_offset=seen.u, y_offset=seen.v, width=seen.width, height=seen.height
    )
    k, r, p = (np.asarray(matrix, np.float64).ravel() for matrix in (camera.k, camera.r, camera.p))
    return make(
        CAMERA_INFO, header=head, height=camera.height, width=camera.width, distortion_model=camera.distortion_model,
        d=make.doubles(camera.d), k=k, r=r, p=p, roi=region,
    )  # fmt: skip


def ideal_camera(intrinsics: Matrix, size: tuple[int, int]) -> CameraModel:
    """A camera without distortion or rotation: ``D = 0``, ``R = I``, ``P = [K | 0]``.

    Parameters
    ----------
    intrinsics : (3, 3) float64
    size : (int, int)
        Width and height, px.
    """
    return CameraModel(*size, intrinsics, np.zeros(5), np.eye(3), np.hstack([intrinsics, np.zeros((3, 1))]))


def rectified_cameras(geometry: StereoGeometry, size: tuple[int, int]) -> tuple[CameraModel, CameraModel]:
    """Both rectified views as cameras, of `size` (width, height) px."""
    left = replace(ideal_camera(geometry.intrinsics_left, size), r=np.asarray(geometry.rect_from_raw_left, np.float64))
    along = 0 if geometry.axis == "horizontal" else 1
    intrinsics = geometry.intrinsics_left
    intrinsics[along, 2] = geometry.cx_right
    right = ideal_camera(intrinsics, size)
    right.p[along, 3] = _shift(geometry)
    return left, right


def _shift(geometry: StereoGeometry) -> float:
    """``-f B``, or the NaN that stands for it."""
    if geometry.baseline_m is None:
        return math.copysign(math.nan, geometry.baseline_sign)
    return -geometry.focal_px * geometry.baseline_m


def rectified_infos(make: MessageFactory, pair: RectifiedPair) -> tuple[Any, Any]:
    """CameraInfo of both views of a rectified pair."""
    height, width = pair.left.shape[:2]
    left, right = rectified_cameras(pair.geometry, (width, height))
    head = header(make, pair.stamp_ns, pair.frame_id)
    return (
        camera_info_message(make, left, head, pair.valid_left),
        camera_info_message(make, right, head, pair.valid_right),
    )
