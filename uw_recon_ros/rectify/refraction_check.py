"""A rig calibrated in air and used in water: how its matches give it away.

Behind a flat port a ray enters the camera by Snell's law, ``sin(air) = n sin(water)``: to first order as if the focal
length had grown by water's refractive index n, 1.33. Rectifying with the air's numbers then leaves rows that disagree,
unless the cameras are exactly parallel, and depth comes out a quarter short. So: bend the calibration's rays by one
common index, and see whether the rows agree at one that only water has. Ports and mounting also shift all rows by
some pixels, which no index explains: so at each index the median is taken out first (of 11 real tank pairs all are
named so, ``test/benchmark/medium.py``). Rows that agree at 1 and would not at water's index say the contrary; where
both
agree alike, nothing can be told. A rig whose pitch has moved by a third of what it was looks nearly the same; the
warning says so by asking.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from uw_recon_ros.rectify.rectified_camera import RectifiedCamera, Views, undistorted
from uw_recon_ros.rectify.tie_points import TiePoints
from uw_recon_ros.types import Axis, Matrix

_INDICES = np.linspace(0.9, 1.6, 71)
_ONE, _WATER_INDEX = 1.0, 1.333
_WATER = (1.25, 1.4)  # fresh to sea water 1.333 to 1.343, and what noise and the port's gap add
_AS_CALIBRATED = (0.92, 1.1)
_LEAST_PX = 0.3  # rows that agree better than that need no explanation
_IMPROVEMENT = 0.5
_CONTRADICTION = 1.5  # how much worse the rows would be in the other medium
_MINIMUM = 30

Medium = Literal["water", "as calibrated", "cannot tell"]


@dataclass(frozen=True)
class PortIndex:
    """Which refractive index in front of flat ports makes the rows of a calibrated rig agree best.

    Parameters
    ----------
    index : float
        1: the rig works in what it was calibrated in.
    row_error_px, row_error_at_one_px, row_error_in_water_px : float
        Median distance of the rows from their common shift, at that index, at 1 and at water's, px.
    """

    index: float
    row_error_px: float
    row_error_at_one_px: float
    row_error_in_water_px: float

    @property
    def medium(self) -> Medium:
        """``water``: an in-air calibration used in water explains the rows."""
        at_one = self.row_error_at_one_px
        explained = at_one > _LEAST_PX and self.row_error_px <= _IMPROVEMENT * at_one
        if explained and _WATER[0] <= self.index <= _WATER[1]:
            return "water"
        agrees = _AS_CALIBRATED[0] <= self.index <= _AS_CALIBRATED[1]
        against_water = self.row_error_in_water_px > max(_CONTRADICTION * at_one, _LEAST_PX)
        return "as calibrated" if agrees and against_water else "cannot tell"


def refracted(rays: Matrix, index: float) -> Matrix:
    """Rays (x, y, 1) in water of rays in air behind a flat port in front of the pinhole, (N, 2) to (N, 2)."""
    radius = np.linalg.norm(rays, axis=1, keepdims=True)
    sine = radius / np.sqrt(1 + radius**2) / index
    bent: Matrix = rays * sine / np.sqrt(1 - sine**2) / np.maximum(radius, 1e-12)
    return bent


def _row_error(rays: tuple[Matrix, Matrix], views: Views, across: int, index: float) -> float:
    """Median distance of the rows from their common shift, px, of rays in water.

    The rectified focal length grows as the image has.
    """
    rows = []
    for ray, view in zip(rays, views, strict=True):
        turned = refracted(ray, index) @ view.r[:, :2].T + view.r[:, 2]
        rows.append(index * view.k_new[across, across] * turned[:, across] / turned[:, 2] + view.k_new[across, 2])
    apart = rows[0] - rows[1]
    return float(np.nanmedian(np.abs(apart - np.nanmedian(apart))))


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
    at_one, in_water = (_row_error(shown, (left, right), across, index) for index in (_ONE, _WATER_INDEX))
    return PortIndex(float(_INDICES[best]), float(errors[best]), at_one, in_water)
