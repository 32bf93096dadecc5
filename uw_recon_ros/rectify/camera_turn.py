"""Whether the rows of a calibrated pair disagree as they do where a camera has been turned since its calibration.

A right camera turned by the small rotation w sees the ray p at ``p - w x p``; so its rows lie
``f (w_z x - w_x (1 + y^2) + w_y x y)`` higher: pitch shifts them, roll tilts them, yaw hardly shows. A lens
that was zoomed leaves another pattern; a crop or a tilted port shift rows as pitch does, and so, where the cameras
stand at an angle to each other, does a calibration for another image size.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from uw_recon_ros.rectify.rectification import Rectification
from uw_recon_ros.rectify.tie_points import TiePoints
from uw_recon_ros.types import Matrix

_FEWEST = 40  # points: every second one is fitted to, the others judge
_ITERATIONS = 10
_SMALLEST_PX = 0.02
_YAW = 0.01  # rad, standard deviation: rows tell little of it
_EXPLAINED = 0.5  # of the error, at most left over


@dataclass(frozen=True)
class CameraTurn:
    """How far the right camera has been turned against the left one.

    Parameters
    ----------
    pitch_deg, roll_deg : float
        About the baseline, and about the line of sight; by the right-hand rule in the rectified frame (x right, y down,
        z ahead).
    before_px, after_px : float
        Median magnitude of the row error without and with the turn, at tie points that it was not fitted to, px.
    """

    pitch_deg: float
    roll_deg: float
    before_px: float
    after_px: float

    @property
    def explains(self) -> bool:
        """Whether it leaves little of the row error."""
        return self.after_px <= _EXPLAINED * self.before_px

    def __str__(self) -> str:
        return (
            f"{abs(self.pitch_deg):.2f} degrees about the baseline and {abs(self.roll_deg):.2f} about its line of sight"
        )


def camera_turn(rectification: Rectification, tie_points: TiePoints) -> CameraTurn | None:
    """The turn of the right camera by which rows agree best, by least magnitudes.

    Parameters
    ----------
    rectification : Rectification
        As calibrated.
    tie_points : TiePoints
        Raw px.

    Returns
    -------
    CameraTurn or None
        None for fewer than 40 tie points.
    """
    errors, right = rectification.row_errors(tie_points), rectification.rectified(tie_points)[1]
    seen = np.isfinite(errors)
    if seen.sum() < _FEWEST:
        return None
    view, horizontal = rectification.right.k_new, rectification.geometry.axis == "horizontal"
    slopes = _slopes(right[seen], view, horizontal)
    errors = errors[seen]
    turn = _fitted(slopes[::2], errors[::2])
    before, after = (float(np.median(np.abs(rest))) for rest in (errors[1::2], (errors - slopes @ turn)[1::2]))
    pitch, roll, _ = np.degrees(turn)
    return CameraTurn(float(pitch), float(roll), before, after)


def _slopes(pixels: Matrix, k_new: Matrix, horizontal: bool) -> Matrix:
    """Of left minus right row by pitch, roll and yaw of the right camera, px a radian, (N, 3)."""
    x, y = ((pixels - k_new[:2, 2]) / np.diag(k_new)[:2]).T
    if horizontal:
        return float(k_new[1, 1]) * np.column_stack([-(1 + y**2), x, x * y])
    return float(k_new[0, 0]) * np.column_stack([1 + x**2, -y, -x * y])


def _fitted(slopes: Matrix, errors: Matrix) -> Matrix:
    """(pitch, roll, yaw) of least magnitudes, rad."""
    ridge, weights, turn = np.diag([0.0, 0.0, 1 / _YAW**2]), np.ones(len(errors)), np.zeros(3)
    for _ in range(_ITERATIONS):
        weighted = slopes * weights[:, None]
        turn = np.linalg.solve(weighted.T @ slopes + ridge, weighted.T @ errors)
        weights = 1 / np.maximum(np.abs(errors - slopes @ turn), _SMALLEST_PX)
    return turn
