"""A seam: above a row of the image the rows of both cameras agree, below it they do not, or the other way round.

So looks a frame whose lower part was taken at another time, as of a transfer that was overtaken by the next.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from uw_recon_ros.findings import Code, Finding
from uw_recon_ros.rectify.rectification import Rectification
from uw_recon_ros.rectify.tie_points import TiePoints
from uw_recon_ros.types import Matrix

_FEWEST = 30  # tie points on either side
_LEAST_SHARE = 0.08  # of the tie points on either side
_CANDIDATES = 64
_STEP_PX = 1.0  # least jump of the median, for an image 480 px high; a rig out of adjustment has a slope, and no jump
_STEP_SPREADS = 3.0  # ... and times the mean deviation on either side
_NEAR_SHARE = 0.08  # of the tie points: those next to the seam on either side ...
_SUDDEN = 0.6  # ... between which most of the difference must lie: over a slope it does not


@dataclass(frozen=True)
class Seam:
    """Where the row error jumps.

    Parameters
    ----------
    row : int
        First raw row of the lower part, left image, px.
    above_px, below_px : float
        Median row error on either side, px.
    share : float
        Of the image's height: the part whose rows agree less.
    """

    row: int
    above_px: float
    below_px: float
    share: float

    @property
    def lower(self) -> bool:
        """Whether it is the lower part that disagrees."""
        return abs(self.below_px) > abs(self.above_px)


def find_seam(tie_points: TiePoints, row_errors: Matrix) -> Seam | None:
    """Find the row at which the row error jumps.

    Parameters
    ----------
    tie_points : TiePoints
        Of one frame.
    row_errors : (N,) float64
        Of `Rectification.row_errors`, px; NaN does not count.

    Returns
    -------
    Seam or None
        None: there is no jump, or there are too few tie points to tell.
    """
    known = np.isfinite(row_errors)
    order = np.argsort(tie_points.left[known, 1], kind="stable")
    v, errors = tie_points.left[known, 1][order], row_errors[known][order]
    least = max(_FEWEST, int(_LEAST_SHARE * len(v)))
    if len(v) < 2 * least:
        return None
    splits = np.unique(np.linspace(least, len(v) - least, _CANDIDATES).astype(int))
    at = int(min(splits, key=lambda i: _deviation(errors[:i]) + _deviation(errors[i:])))
    return _judged(v, errors, at, tie_points.height)


def torn(rectification: Rectification, tie_points: TiePoints) -> tuple[Finding, ...]:
    """A finding where a frame's rows agree on one side of a row only; which camera is torn they do not tell."""
    seam = find_seam(tie_points, rectification.row_errors(tie_points))
    if seam is None:
        return ()
    part, good = ("below", seam.above_px) if seam.lower else ("above", seam.below_px)
    text = (
        f"left or right camera: the image is torn at row {seam.row}: {part} it ({seam.share:.0%} of the image) the "
        f"vertical (epipolar) error is {max(abs(seam.above_px), abs(seam.below_px)):.1f} px, on the other side "
        f"{abs(good):.1f} px"
    )
    return (Finding(Code.REGION_TORN, text, advice="that part was taken at another time: check the transfer"),)


def _deviation(errors: Matrix) -> float:
    return float(np.abs(errors - np.median(errors)).sum())


def _judged(v: Matrix, errors: Matrix, at: int, height: int) -> Seam | None:
    above, below = errors[:at], errors[at:]
    spread = (_deviation(above) + _deviation(below)) / len(v)
    near = max(_FEWEST // 2, int(_NEAR_SHARE * len(v)))
    jump = float(np.median(below[:near]) - np.median(above[-near:]))
    if abs(jump) < max(_STEP_PX * height / 480, _STEP_SPREADS * spread):
        return None
    if abs(jump) < _SUDDEN * abs(float(np.median(below) - np.median(above))):
        return None
    row = round(float(v[at - 1] + v[at]) / 2)
    seam = Seam(row, float(np.median(above)), float(np.median(below)), 0.0)
    share = (height - row if seam.lower else row) / height
    return Seam(row, seam.above_px, seam.below_px, share)
