"""A rig calibrated in air and used in water: how its matches give it away.

Behind a flat port the image of the same ray widens by water's refractive index, as if the focal length had grown by
about 1.31 to 1.33. Undistorting with the air's numbers then leaves rows that disagree, unless the cameras are exactly
parallel, and depth comes out about a quarter short. So: shrink the rays of the calibration by one common ratio, and see
whether the rows agree at a ratio that only water explains.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from uw_recon_ros.rectify.tie_points import TiePoints
from uw_recon_ros.rectify.views import View, undistorted
from uw_recon_ros.types import Axis, Matrix

_RATIOS = np.linspace(1.0, 1.6, 61)
_WATER = (1.22, 1.45)
_ROW_ERROR_PX = 1.0  # rows that agree better than that need no explanation
_IMPROVEMENT = 0.5
_MINIMUM = 30


@dataclass(frozen=True)
class FocalRatio:
    """Which common change of focal length makes the rows agree best.

    Parameters
    ----------
    ratio : float
        ``f_used / f_calibrated``.
    row_error_px, row_error_at_one_px : float
        Median row error at that ratio and at 1, px.
    """

    ratio: float
    row_error_px: float
    row_error_at_one_px: float

    @property
    def water(self) -> bool:
        """Whether only an in-air calibration used in water explains it."""
        explained = self.row_error_px <= _IMPROVEMENT * self.row_error_at_one_px
        return self.row_error_at_one_px > _ROW_ERROR_PX and explained and _WATER[0] <= self.ratio <= _WATER[1]


def _row_error(rays: tuple[Matrix, Matrix], views: tuple[View, View], across: int, ratio: float) -> float:
    """Median row error, px, of rays shrunk by `ratio`, the rectified focal length grown by as much."""
    rows = []
    for ray, view in zip(rays, views, strict=True):
        turned = (ray / ratio) @ view.r[:, :2].T + view.r[:, 2]
        rows.append(ratio * view.k_new[across, across] * turned[:, across] / turned[:, 2] + view.k_new[across, 2])
    return float(np.nanmedian(np.abs(rows[0] - rows[1])))


def focal_ratio(tie_points: TiePoints, left: View, right: View, axis: Axis) -> FocalRatio | None:
    """Search for the common focal ratio that makes the rows of a calibrated rig agree.

    Parameters
    ----------
    tie_points : TiePoints
        Raw px.
    left, right : View
        As calibrated.
    axis : {'horizontal', 'vertical'}

    Returns
    -------
    FocalRatio or None
        None for fewer than 30 tie points.
    """
    rays = undistorted(left, tie_points.left), undistorted(right, tie_points.right)
    seen = np.isfinite(np.hstack(rays)).all(axis=1)
    if seen.sum() < _MINIMUM:
        return None
    shown = rays[0][seen], rays[1][seen]
    across = 1 if axis == "horizontal" else 0
    errors = np.array([_row_error(shown, (left, right), across, ratio) for ratio in _RATIOS])
    best = int(errors.argmin())
    return FocalRatio(float(_RATIOS[best]), float(errors[best]), float(errors[0]))
