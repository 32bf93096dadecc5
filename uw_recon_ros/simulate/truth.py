"""True depth seen from where an estimate is: out of a recorded depth map of the raw image, without the scene."""

from __future__ import annotations

import numpy as np

from uw_recon_ros.simulate.rig import distort, pinhole_directions
from uw_recon_ros.types import CameraModel, FloatImage, Matrix, StereoGeometry

_ONE_SURFACE = 1.03  # ratio of the four neighbours' depths up to which they are taken for one surface


def rectify_depth(
    depth: FloatImage, camera: CameraModel, geometry: StereoGeometry, width: int, height: int
) -> FloatImage:
    """Depth in a rectified left view from depth in the raw left image.

    Inverse depth is interpolated between the four pixels around each place (exact on a plane), unless they belong to
    different surfaces: then the nearest pixel counts.

    Parameters
    ----------
    depth : (H, W) float32
        Of the raw left image, m along its optical axis; NaN = invalid.
    camera : CameraModel
        The left camera: intrinsics and distortion (plumb_bob).
    geometry : StereoGeometry
        Of the rectified view: its left intrinsics and rotation are used.
    width, height : int
        Of the rectified view, px.

    Returns
    -------
    (height, width) float32
        m along the rectified view's optical axis; NaN where the raw image knows nothing.
    """
    if depth.shape != (camera.height, camera.width):
        raise ValueError(f"depth: expected {(camera.height, camera.width)} as the camera has, got {depth.shape}")
    if camera.distortion_model != "plumb_bob":
        raise ValueError(f"camera: expected plumb_bob distortion, got {camera.distortion_model}")
    rect_from_raw = np.array(geometry.rect_from_raw_left)
    rays = pinhole_directions(geometry.intrinsics_left, width, height) @ rect_from_raw  # in the raw camera's frame
    with np.errstate(divide="ignore", invalid="ignore"):
        ideal = np.where(rays[..., 2:] > 0, rays[..., :2] / rays[..., 2:], np.nan)
    moved = distort(ideal, camera.d)
    u = moved[..., 0] * camera.k[0, 0] + camera.k[0, 2]
    v = moved[..., 1] * camera.k[1, 1] + camera.k[1, 2]
    along_raw_axis = 1.0 / _sample_inverse(1.0 / depth.astype(np.float64), u, v)
    points = rays / rays[..., 2:] * along_raw_axis[..., None]
    rectified: FloatImage = (points @ rect_from_raw[2]).astype(np.float32)
    return rectified


def _sample_inverse(inverse: Matrix, u: Matrix, v: Matrix) -> Matrix:
    """Bilinear within one surface, nearest across a jump, NaN outside."""
    rows, columns = inverse.shape
    inside = (u >= -0.5) & (u <= columns - 0.5) & (v >= -0.5) & (v <= rows - 0.5)
    u, v = np.where(inside, u, 0.0).clip(0, columns - 1), np.where(inside, v, 0.0).clip(0, rows - 1)
    i, j = np.minimum(u.astype(int), columns - 2), np.minimum(v.astype(int), rows - 2)
    corners = np.stack([inverse[j, i], inverse[j, i + 1], inverse[j + 1, i], inverse[j + 1, i + 1]])
    x, y = u - i, v - j
    shares = np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y])
    nearest = np.take_along_axis(corners, shares.argmax(axis=0)[None], axis=0)[0]
    smooth = corners.max(axis=0) <= _ONE_SURFACE * corners.min(axis=0)  # false where one is NaN
    sampled: Matrix = np.where(inside, np.where(smooth, (shares * corners).sum(axis=0), nearest), np.nan)
    return sampled
