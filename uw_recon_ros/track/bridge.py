"""The bridge where features are lost: the shapes of two depth maps laid onto each other (point to plane)."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from uw_recon_ros import rigid
from uw_recon_ros.track.keypoints import RigError, points_of
from uw_recon_ros.track.relate import RelativePose, projected
from uw_recon_ros.types import FloatImage, Matrix, StereoGeometry

_STRIDE = 8  # px between points
_NEAR_M, _NEAR_SHARE = 0.02, 0.05  # planes within this distance, or share of the depth, may be the same
_ROUNDS = 25
_LEAST_POINTS = 150
_SHARED = 30.0  # points whose depths are wrong together: a bridge knows that much less than it counts


@dataclass(frozen=True, eq=False)
class Relief:
    """The bottom as one frame sees it, thinned out.

    Parameters
    ----------
    points, normals : (H, W, 3) float64
        Left rectified frame, m; NaN = unknown.
    sigma : (H, W) float64
        Of the depth, m.
    """

    points: Matrix
    normals: Matrix
    sigma: Matrix


def make_relief(disparity: FloatImage, sigma: FloatImage, geometry: StereoGeometry) -> Relief:
    """Every eighth pixel of a disparity map, smoothed over as much, with its normal."""
    weight = np.isfinite(disparity).astype(np.float32)
    size = (_STRIDE, _STRIDE)
    share = cv2.blur(weight, size)
    smooth = cv2.blur(np.nan_to_num(disparity).astype(np.float32), size) / np.maximum(share, 1e-6)
    smooth = np.where(share > 0.5, smooth, np.nan)[_STRIDE // 2 :: _STRIDE, _STRIDE // 2 :: _STRIDE]
    rows, columns = smooth.shape
    v, u = np.mgrid[:rows, :columns] * _STRIDE + (_STRIDE - 1) / 2 + 0.5
    points = points_of(np.stack([u.ravel(), v.ravel(), smooth.ravel()], axis=1), geometry).reshape(rows, columns, 3)
    normals = np.full_like(points, np.nan)
    across = points[1:-1, 2:] - points[1:-1, :-2]
    along = points[2:, 1:-1] - points[:-2, 1:-1]
    cross = np.cross(along, across)
    normals[1:-1, 1:-1] = cross / np.linalg.norm(cross, axis=-1, keepdims=True)
    depth = points[..., 2]
    spread = np.nan_to_num(sigma, nan=1.0)[_STRIDE // 2 :: _STRIDE, _STRIDE // 2 :: _STRIDE]
    return Relief(points, normals, depth**2 / abs(geometry.focal_times_baseline) * np.maximum(spread, 0.05))


def _pairs(first: Relief, second: Relief, motion: Matrix, geometry: StereoGeometry) -> tuple[Matrix, ...]:
    """Second's points in the first's frame, the planes they fall onto (point, normal), and their sigma."""
    points = second.points.reshape(-1, 3) @ motion[:3, :3].T + motion[:3, 3]
    place = np.rint((projected(points, geometry, RigError())[:, :2] - _STRIDE / 2) / _STRIDE)
    rows, columns = first.sigma.shape
    u, v = np.nan_to_num(place, nan=-1).astype(int).T
    inside = (u >= 0) & (u < columns) & (v >= 0) & (v < rows)
    u, v, points = u[inside], v[inside], points[inside]
    onto, normals = first.points[v, u], first.normals[v, u]
    sigma = np.hypot(first.sigma[v, u], second.sigma.ravel()[inside])
    near = np.abs(((points - onto) * normals).sum(axis=1)) < _NEAR_M + _NEAR_SHARE * points[:, 2]
    near &= np.isfinite(sigma)
    return points[near], onto[near], normals[near], sigma[near]


def bridge(
    first: Relief, second: Relief, geometry: StereoGeometry, guess: Matrix, known_m: float, known_rad: float = 0.05
) -> RelativePose | None:
    """Lay two reliefs onto each other.

    Parameters
    ----------
    first, second : Relief
    geometry : StereoGeometry
    guess : (4, 4) float64
        First <- second, e.g. the motion before.
    known_m, known_rad : float
        How sure a motion must be in every direction: a flat bottom says nothing of the way along it, and is refused.

    Returns
    -------
    RelativePose or None
    """
    motion = guess
    for _ in range(_ROUNDS):
        points, onto, normals, sigma = _pairs(first, second, motion, geometry)
        if len(points) < _LEAST_POINTS:
            return None
        residuals = ((onto - points) * normals).sum(axis=1) / sigma
        slopes = np.concatenate([normals, np.cross(points, normals)], axis=1) / sigma[:, None]
        weights = np.minimum(1.0, 2.0 / np.maximum(np.abs(residuals), 1e-9))
        normal = slopes.T @ (weights[:, None] * slopes) + 1e-6 * np.eye(6)
        step = np.linalg.solve(normal, slopes.T @ (weights * residuals))
        motion = rigid.exp(step) @ motion
        if np.abs(step).max() < 1e-6:
            break
    chi2 = float(np.mean(np.minimum(residuals**2, 11.3)))
    change = rigid.adjoint(rigid.inverse(motion))  # a twist on the left becomes one on the right
    covariance = change @ np.linalg.inv(normal) @ change.T * max(chi2, 1.0) * _SHARED
    spread = np.sqrt(np.diag(covariance))
    moved = np.linalg.norm(rigid.log(rigid.inverse(guess) @ motion)[:3])
    if spread[:3].max() > known_m or spread[3:].max() > known_rad or moved > 10 * known_m:
        return None
    return RelativePose(motion, covariance, len(points), chi2)
