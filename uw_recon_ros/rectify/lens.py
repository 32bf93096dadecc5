"""Radial distortion of an uncalibrated rig's lenses: one term, the same for both cameras.

It is measured where the picture ends: a point at the radius R of the image's corners is seen at ``R (1 + bend)``, one
at the radius r at ``r (1 + bend (r / R)^2)``, which is ``k1 = bend (f / R)^2`` of a lens of focal length f.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from uw_recon_ros.rectify.rectified_camera import RectifiedCamera, undistorted
from uw_recon_ros.rectify.tie_points import TiePoints
from uw_recon_ros.types import Matrix

UNKNOWN = 0.04  #: standard deviation of the bend that nobody has measured: of a lens behind a port


@dataclass(frozen=True)
class Lens:
    """The bend (see the head of the file), and its standard deviation."""

    bend: float = 0.0
    sigma: float = UNKNOWN

    def straightened(self, tie_points: TiePoints) -> TiePoints:
        """The tie points as a lens without distortion shows them; without those that no ray leads to."""
        if self.bend == 0:
            return tie_points
        left, right = (_straightened(p, tie_points, self.bend) for p in (tie_points.left, tie_points.right))
        there = np.isfinite(left).all(axis=1) & np.isfinite(right).all(axis=1)
        return TiePoints(left[there], right[there], tie_points.width, tie_points.height)

    def distortion(self, focal_px: float, width: int, height: int) -> Matrix:
        """As OpenCV and ``plumb_bob`` have it, (5,): k1 and zeros."""
        return np.array([self.bend * (focal_px / _corner(width, height)) ** 2, 0, 0, 0, 0])


def _corner(width: int, height: int) -> float:
    """Its distance from the middle, px."""
    return float(np.hypot(width - 1, height - 1)) / 2


def _straightened(pixels: Matrix, tie_points: TiePoints, bend: float) -> Matrix:
    radius = _corner(tie_points.width, tie_points.height)
    middle = np.array([tie_points.width - 1, tie_points.height - 1]) / 2
    k = np.array([[radius, 0, middle[0]], [0, radius, middle[1]], [0, 0, 1.0]])
    rays = undistorted(RectifiedCamera(k, np.eye(3), k, np.array([bend, 0, 0, 0, 0.0])), pixels)
    straight: Matrix = middle + radius * rays
    return straight
