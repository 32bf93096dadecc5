"""Disparity to depth to points (paper eq. 18). The formula itself stands in `StereoGeometry`."""

from __future__ import annotations

from typing import Literal

import numpy as np

from uw_recon_ros.types import ByteImage, FloatImage, Matrix, Status, StereoGeometry

CloudFrame = Literal["optical", "rectified"]


def triangulate(
    disparity: FloatImage,
    sigma: FloatImage,
    status: ByteImage,
    geometry: StereoGeometry,
    max_relative_sigma: float = np.inf,
) -> tuple[FloatImage, FloatImage, ByteImage]:
    """Depth, its standard deviation, and why a pixel has none.

    Parameters
    ----------
    disparity, sigma : (H, W) float32
        px; NaN = invalid.
    status : (H, W) uint8
        `Status` bits of the disparity.
    geometry : StereoGeometry
    max_relative_sigma : float
        Depths less certain than this share of themselves are no depths: the inverse of a disparity near zero has
        neither mean nor variance.

    Returns
    -------
    depth, sigma : (H, W) float32
        m, or baselines where the scale is unknown; NaN = invalid.
    status : (H, W) uint8
        `Status.OUT_OF_RANGE` added where there is a disparity but no depth.
    """
    depth = geometry.depth_from_disparity(disparity)
    depth_sigma = geometry.depth_sigma(depth, sigma)
    with np.errstate(invalid="ignore"):
        uncertain = depth_sigma > np.float32(max_relative_sigma) * depth
    depth = np.where(uncertain, np.float32(np.nan), depth)
    lost = np.isfinite(disparity) & np.isnan(depth)
    out_of_range = np.where(lost, np.uint8(Status.OUT_OF_RANGE), np.uint8(0))
    return depth, np.where(np.isnan(depth), depth, depth_sigma), status | out_of_range


def points_from_depth(depth: FloatImage, geometry: StereoGeometry, frame: CloudFrame = "optical") -> FloatImage:
    """Back-project every pixel.

    Parameters
    ----------
    depth : (H, W) float32
        Along the optical axis of the rectified view; NaN = invalid.
    geometry : StereoGeometry
    frame : {'optical', 'rectified'}
        ``optical``: the unrotated left optical frame (the rectifying rotation is undone).

    Returns
    -------
    (H, W, 3) float32
        x, y, z in the unit of `depth`.
    """
    height, width = depth.shape
    k = geometry.intrinsics_left
    along_u = np.outer(frame_from_rect(geometry, frame)[:, 0], (np.arange(width) - k[0, 2]) / k[0, 0])
    along_v = np.outer(frame_from_rect(geometry, frame)[:, 1], (np.arange(height) - k[1, 2]) / k[1, 1])
    along_v += frame_from_rect(geometry, frame)[:, 2:]
    points = np.empty((height, width, 3), np.float32)
    for axis in range(3):
        ray = along_u[axis].astype(np.float32)[None, :] + along_v[axis].astype(np.float32)[:, None]
        np.multiply(ray, depth, out=points[..., axis])
    return points


def frame_from_rect(geometry: StereoGeometry, frame: CloudFrame) -> Matrix:
    """(3, 3) rotation from the rectified left frame to `frame`."""
    if frame == "rectified":
        return np.eye(3)
    if frame != "optical":
        raise ValueError(f"frame: expected 'optical' or 'rectified', got {frame!r}")
    raw_from_rect: Matrix = np.array(geometry.rect_from_raw_left, np.float64).T
    return raw_from_rect


def normals_from_slopes(
    level: FloatImage, slope_u: FloatImage, slope_v: FloatImage, geometry: StereoGeometry, frame: CloudFrame
) -> FloatImage:
    """Normals of the planes that disparities with slopes belong to.

    With ``s = d + offset = f B / Z``, a plane ``s = a u + b v + c`` is ``(K^T (a, b, c)) . X = f B`` in space.

    Parameters
    ----------
    level : (H, W) float32
        ``d + offset``, px; NaN = invalid.
    slope_u, slope_v : (H, W) float32
        Its derivatives, px per px.
    geometry : StereoGeometry
    frame : {'optical', 'rectified'}

    Returns
    -------
    (H, W, 3) float32
        Unit length, towards the camera; NaN where `level` is.
    """
    height, width = level.shape
    k = geometry.intrinsics_left.astype(np.float32)
    u = np.arange(width, dtype=np.float32)[None, :] - k[0, 2]
    v = np.arange(height, dtype=np.float32)[:, None] - k[1, 2]
    nx, ny = k[0, 0] * slope_u, k[1, 1] * slope_v
    nz = level - slope_u * u - slope_v * v
    scale = np.float32(-np.sign(geometry.focal_times_baseline)) / np.sqrt(nx * nx + ny * ny + nz * nz)
    rotation = frame_from_rect(geometry, frame).astype(np.float32)
    normals = np.empty((height, width, 3), np.float32)
    for axis, (a, b, c) in enumerate(rotation):
        normals[..., axis] = (a * nx + b * ny + c * nz) * scale
    return normals
