"""The rectified view of one camera: how its pixels and those of the raw image are found from each other."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from uw_recon_ros.rectify.sampson import homogeneous
from uw_recon_ros.types import CameraModel, Matrix

_NEWTON_STEPS = 4
_NEWTON_STEP = 1e-7


@dataclass(frozen=True, eq=False)
class RectifiedCamera:
    """One camera, raw and rectified: ``x_rect = k_new @ r @ undistort(k^-1 @ x_raw)``.

    Parameters
    ----------
    k : (3, 3) float64
        Intrinsic matrix of the raw image, assumed or calibrated.
    r : (3, 3) float64
        Rotation from the raw to the rectified camera frame.
    k_new : (3, 3) float64
        Intrinsic matrix of the rectified image.
    d : (N,) float64
        Distortion coefficients; all zero: none.
    distortion_model : str
        As in `CameraModel`.
    """

    k: Matrix
    r: Matrix
    k_new: Matrix
    d: Matrix = field(default_factory=lambda: np.zeros(5))
    distortion_model: str = "plumb_bob"

    @classmethod
    def of_camera(cls, camera: CameraModel) -> RectifiedCamera:
        """The view that a calibration prescribes."""
        return cls(camera.k, camera.r, camera.p[:, :3], camera.d, camera.distortion_model)

    @property
    def distorted(self) -> bool:
        """Whether straight lines are bent in the raw image."""
        return bool(self.d.any())

    @property
    def homography(self) -> Matrix:
        """(3, 3) rectified from raw pixels, leaving the distortion aside (paper eq. 14)."""
        return self.k_new @ self.r @ _inverse(self.k)

    @property
    def identity(self) -> bool:
        """Whether raw pixels are the rectified ones."""
        return not self.distorted and bool(np.abs(self.homography - np.eye(3)).max() < 1e-9)

    def moved(self, u: float, v: float) -> RectifiedCamera:
        """The same view with its image's origin at pixel (u, v) of this one."""
        return replace(self, k_new=np.array([[1, 0, -u], [0, 1, -v], [0, 0, 1.0]]) @ self.k_new)

    def transposed(self) -> RectifiedCamera:
        """Rows and columns exchanged, raw and rectified; for lenses whose distortion is radial."""
        if self.d[2:4].any() or self.distortion_model != "plumb_bob":
            raise ValueError(f"view: expected radial distortion to exchange rows and columns, got {self.d}")
        swap = np.eye(3)[[1, 0, 2]]
        return replace(self, k=swap @ self.k @ swap, r=swap @ self.r @ swap, k_new=swap @ self.k_new @ swap)

    def rectified(self, raw: Matrix) -> Matrix:
        """Rectified pixels of raw ones, (N, 2) px to (N, 2) px; NaN behind the rectified camera."""
        return _project(self.k_new @ self.r, undistorted(self, raw))

    def raw(self, rectified: Matrix) -> Matrix:
        """Raw pixels of rectified ones, (N, 2) px to (N, 2) px; NaN behind the raw camera."""
        rays = _project(self.r.T @ _inverse(self.k_new), rectified)
        return distorted(self, rays)

    def raw_grid(self, width: int, height: int) -> Matrix:
        """`raw` of every pixel of a rectified image of that size, (height, width, 2) px."""
        matrix = self.r.T @ _inverse(self.k_new)
        if not self.distorted:
            matrix = self.k @ matrix
        u, v = np.arange(width), np.arange(height)[:, None]
        x, y, z = (row[0] * u + (row[1] * v + row[2]) for row in matrix)
        with np.errstate(divide="ignore", invalid="ignore"):
            inverse = np.where(z > 0, 1 / z, np.nan)
        grid = np.stack([x * inverse, y * inverse], axis=2)
        return distorted(self, grid.reshape(-1, 2)).reshape(grid.shape) if self.distorted else grid


#: Left and right.
Views = tuple[RectifiedCamera, RectifiedCamera]


def _inverse(matrix: Matrix) -> Matrix:
    return np.asarray(np.linalg.inv(matrix), np.float64)


def _project(matrix: Matrix, points: Matrix) -> Matrix:
    """Homography of (N, 2) points; NaN where they come out behind."""
    mapped = points @ matrix[:, :2].T + matrix[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        result: Matrix = np.where(mapped[:, 2:] > 0, mapped[:, :2] / mapped[:, 2:], np.nan)
    return result


def distorted(view: RectifiedCamera, rays: Matrix) -> Matrix:
    """Raw pixels of undistorted rays ``(x, y, 1)``.

    Parameters
    ----------
    view : RectifiedCamera
    rays : (N, 2) float64
        NaN stays NaN.

    Returns
    -------
    (N, 2) float64
        px.
    """
    if not view.distorted:
        pixels: Matrix = homogeneous(rays) @ view.k[:2].T
        return pixels
    known = np.where(np.isfinite(rays).all(axis=1, keepdims=True), rays, 0.0)[:, None, :]
    if view.distortion_model == "equidistant":
        bent = cv2.fisheye.distortPoints(known, view.k, view.d)
    else:
        solid = cv2.convertPointsToHomogeneous(known).reshape(-1, 1, 3)
        bent, _ = cv2.projectPoints(solid, np.zeros(3), np.zeros(3), view.k, view.d)
    return np.where(np.isfinite(rays), bent.reshape(-1, 2), np.nan)


def undistorted(view: RectifiedCamera, raw: Matrix) -> Matrix:
    """Rays ``(x, y, 1)`` of raw pixels: OpenCV's start, then Newton on `distorted` to rounding.

    Parameters
    ----------
    view : RectifiedCamera
    raw : (N, 2) float64
        px.

    Returns
    -------
    (N, 2) float64
        NaN where no ray leads there.
    """
    if not view.distorted or not len(raw):
        return _project(_inverse(view.k), raw)
    undistort = cv2.fisheye.undistortPoints if view.distortion_model == "equidistant" else cv2.undistortPoints
    rays: Matrix = undistort(np.ascontiguousarray(raw)[:, None, :], view.k, view.d).reshape(-1, 2).astype(np.float64)
    for _ in range(_NEWTON_STEPS):
        here = distorted(view, rays)
        slopes = np.stack([distorted(view, rays + step) - here for step in _NEWTON_STEP * np.eye(2)], axis=2)
        slopes /= _NEWTON_STEP
        regular = np.abs(np.linalg.det(slopes)) > 1e-9
        slopes[~regular] = np.eye(2) * 1e12
        rays = rays + np.linalg.solve(slopes, (raw - here)[:, :, None])[:, :, 0]
    wrong = ~(np.abs(distorted(view, rays) - raw).max(axis=1) < 1e-3)
    rays[wrong] = np.nan
    return rays
