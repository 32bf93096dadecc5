"""Whether both images of a pair are the same way up: a camera mounted upside down, whose files do not say so."""

from __future__ import annotations

import numpy as np

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.findings import Code
from uw_recon_ros.types import Matrix

_TURNED = np.cos(np.deg2rad(135))
_FEWEST = 8


def check_upright(left: Matrix, right: Matrix) -> None:
    """Refuse matching points (N, 2), px, of which one camera's are turned by about half a turn.

    Raises
    ------
    EstimationError
        They are.
    """
    known = np.isfinite(left).all(axis=1) & np.isfinite(right).all(axis=1)
    if known.sum() < _FEWEST:
        return
    a, b = (points[known] - np.median(points[known], axis=0) for points in (left, right))
    along, across = float((a * b).sum()), float((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum())
    if along < _TURNED * np.hypot(along, across):
        raise EstimationError(
            f"one camera is upside down: expected left and right images the same way up, got the right one turned by "
            f"{abs(np.rad2deg(np.arctan2(across, along))):.0f} deg against the left one (by {known.sum()} tie points), "
            "and no EXIF or rotation flag that says so: turn the images of that camera by 180 deg (ffmpeg -vf "
            "hflip,vflip; mogrify -rotate 180; the driver's flip), and use a calibration made of images so turned",
            Code.RECTIFY_UPSIDE_DOWN,
        )
