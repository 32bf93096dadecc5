"""A rig calibrated in air and used in water: how its matches give it away.

Behind a flat port a ray enters the camera by Snell's law, ``sin(air) = n sin(water)``: to first order as if the focal
length had grown by water's refractive index n, 1.33. Rectifying with the air's numbers then leaves rows that disagree,
unless the cameras are exactly parallel, and depth comes out a quarter short. So: bend the calibration's rays by one
common index, and see whether the rows agree at one that only water has. A rig whose pitch has moved by a third of what
it was looks nearly the same; the warning says so by asking.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from uw_recon_ros.rectify.rectified_camera import RectifiedCamera, Views, undistorted
from uw_recon_ros.rectify.tie_points import TiePoints
from uw_recon_ros.types import Axis, Matrix

_INDICES = np.linspace(1.0, 1.6, 121)
_WATER = (1.29, 1.38)  # fresh to sea water 1.333 to 1.343, and what noise and the port's gap add
_ROW_ERROR_PX = 1.0  # rows that agree better than that need no explanation
_IMPROVEMENT = 0.5
_MINIMUM = 30


@dataclass(frozen=True)
class PortIndex:
    """Which refractive index in front of flat ports makes the rows of a calibrated rig agree best.

    Parameters
    ----------
    index : float
        1: the rig works in what it was calibrated in.
    row_error_px, row_error_at_one_px : float
        Median row error at that index and at 1, px.
    """

    index: float
    row_error_px: float
    row_error_at_one_px: float

    @property
    def water(self) -> bool:
        """Whether an in-air calibration used in water explains the rows."""
        explained = self.row_error_px <= _IMPROVEMENT * self.row_error_at_one_px
        return self.row_error_at_one_px > _ROW_ERROR_PX and explained and _WATER[0] <= self.index <= _WATER[1]


def refracted(rays: Matrix, index: float) -> Matrix:
    """Rays (x, y, 1) in water of rays in air behind a flat port in front of the pinhole, (N, 2) to (N, 2)."""
    radius = np.linalg.norm(rays, axis=1, keepdims=True)
    sine = radius / np.sqrt(1 + radius**2) / index
    bent: Matrix = rays * sine / np.sqrt(1 - sine**2) / np.maximum(radius, 1e-12)
    return bent


def _row_error(rays: tuple[Matrix, Matrix], views: Views, across: int, index: float) -> float:
    """Median row error, px, of rays in water; the rectified focal length grows as the image has."""
    rows = []
    for ray, view in zip(rays, views, strict=True):
        turned = refracted(ray, index) @ view.r[:, :2].T + view.r[:, 2]
        rows.append(index * view.k_new[across, across] * turned[:, across] / turned[:, 2] + view.k_new[across, 2])
    return float(np.nanmedian(np.abs(rows[0] - rows[1])))


def port_index(tie_points: TiePoints, left: RectifiedCamera, right: RectifiedCamera, axis: Axis) -> PortIndex | None:
    """Search for the refractive index that makes the rows of a calibrated rig agree.

    Parameters
    ----------
    tie_points : TiePoints
        Raw px.
    left, right : RectifiedCamera
        As calibrated.
    axis : {'horizontal', 'vertical'}

    Returns
    -------
    PortIndex or None
        None for fewer than 30 tie points.
    """
    rays = undistorted(left, tie_points.left), undistorted(right, tie_points.right)
    seen = np.isfinite(np.hstack(rays)).all(axis=1)
    if seen.sum() < _MINIMUM:
        return None
    shown = rays[0][seen], rays[1][seen]
    across = 1 if axis == "horizontal" else 0
    errors = np.array([_row_error(shown, (left, right), across, index) for index in _INDICES])
    best = int(errors.argmin())
    return PortIndex(float(_INDICES[best]), float(errors[best]), float(errors[0]))
