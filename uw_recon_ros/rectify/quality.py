"""How good a rectification is: distortion of the images, epipoles, flat scenes; and when to refuse it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from uw_recon_ros.findings import Code, Finding
from uw_recon_ros.rectify.fundamental import epipole_inside, epipoles, fit_fundamental
from uw_recon_ros.rectify.params import RectifyParams
from uw_recon_ros.rectify.rectified_camera import RectifiedCamera, Views
from uw_recon_ros.rectify.sampson import homogeneous
from uw_recon_ros.rectify.tie_points import TiePoints
from uw_recon_ros.types import Matrix

_ROLL_LIMIT_DEG = 60.0


@dataclass(frozen=True)
class Distortion:
    """What a homography does to an image's shape (after Mallon and Whelan 2005); 1, 1, 90 is none.

    Parameters
    ----------
    aspect : float
        Ratio of the horizontal to the vertical middle line, over what it was.
    diagonals : float
        Ratio of the diagonals' lengths.
    angle_deg : float
        Between the middle lines, deg.
    """

    aspect: float
    diagonals: float
    angle_deg: float

    def __str__(self) -> str:
        return f"aspect {self.aspect:.2f}, diagonals {self.diagonals:.2f}, angle {self.angle_deg:.0f} deg"


def homography_distortion(homography: Matrix, width: int, height: int) -> Distortion:
    """Measure the distortion of an image of the given size, px; NaN where the image is torn apart at infinity."""
    right, bottom = width - 1.0, height - 1.0
    corners = np.array([[0, 0], [right, 0], [right, bottom], [0, bottom]])
    middles = np.array([[right / 2, 0], [right, bottom / 2], [right / 2, bottom], [0, bottom / 2]])
    mapped = homogeneous(np.vstack([corners, middles])) @ homography.T
    if not ((mapped[:, 2] > 0).all() or (mapped[:, 2] < 0).all()):
        return Distortion(np.nan, np.nan, np.nan)
    a, b, c, d, top, east, bottom_, west = mapped[:, :2] / mapped[:, 2:]
    across, down = east - west, bottom_ - top
    lengths = np.linalg.norm([across, down, c - a, d - b], axis=1)
    cosine = across @ down / (lengths[0] * lengths[1])
    return Distortion(
        float(lengths[0] / lengths[1] * bottom / right),
        float(lengths[2] / lengths[3]),
        float(np.degrees(np.arccos(np.clip(cosine, -1, 1)))),
    )


def homography_share(tie_points: TiePoints, threshold_px: float) -> float:
    """Share of the tie points that one homography explains: near 1, the scene is flat or too far for the baseline."""
    if len(tie_points) < 5:
        return 1.0
    sampled, mask = cv2.findHomography(tie_points.left, tie_points.right, cv2.RANSAC, threshold_px)
    inside = np.zeros(len(tie_points), bool) if sampled is None else mask.ravel().astype(bool)
    if inside.sum() < 5:
        return 0.0
    settled, _ = cv2.findHomography(tie_points.left[inside], tie_points.right[inside], 0)  # a sample's is noisy
    moved = homogeneous(tie_points.left) @ (sampled if settled is None else settled).T
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = np.linalg.norm(moved[:, :2] / moved[:, 2:] - tie_points.right, axis=1)
    return float((distance < threshold_px).mean())


def _torn_or_bent(side: str, distortion: Distortion, params: RectifyParams) -> list[str]:
    low, high = 1 / params.aspect_limit, params.aspect_limit
    straight = abs(distortion.angle_deg - 90) <= params.angle_limit_deg
    if straight and low <= distortion.aspect <= high and low <= distortion.diagonals <= high:
        return []
    return [
        f"the {side} image would be distorted: expected aspect and diagonals {low:.2f} to {high:.2f} and an angle of "
        f"90 +- {params.angle_limit_deg:g} deg, got {distortion}"
    ]


def forward_motion(fundamental: Matrix, tie_points: TiePoints) -> list[str]:
    """A sentence where an epipole lies in its image; else none."""
    size = tie_points.width, tie_points.height
    for side, epipole in zip(("left", "right"), epipoles(fundamental), strict=True):
        if epipole_inside(epipole, *size):
            u, v = epipole[:2] / epipole[2]
            return [
                f"forward motion: the epipole lies in the {side} image, at ({u:.0f}, {v:.0f}) of {size[0]}x{size[1]} "
                "px; expected cameras side by side or one above the other"
            ]
    return []


def _rolled(side: str, view: RectifiedCamera) -> list[str]:
    roll = float(np.degrees(np.arctan2(view.r[1, 0], view.r[0, 0])))
    if abs(roll) <= _ROLL_LIMIT_DEG:
        return []
    return [f"the {side} image would be turned by {roll:.0f} deg: is the baseline along the other axis (rig_axis)?"]


def refusals(
    views: Views,
    fundamental: Matrix,
    tie_points: TiePoints,
    row_error: tuple[float, float],
    params: RectifyParams,
) -> list[str]:
    """Reasons not to use a rectification, with the numbers; none if it is sound.

    Parameters
    ----------
    views : (RectifiedCamera, RectifiedCamera)
        Left and right.
    fundamental : (3, 3) float64
        Of the fit, px.
    tie_points : TiePoints
    row_error : (float, float)
        Median and 95th percentile, px.
    params : RectifyParams
        The limits.
    """
    median, p95 = row_error
    reasons = forward_motion(fundamental, tie_points)
    if not p95 <= params.row_error_limit_px:
        reasons = reasons or forward_motion(fit_fundamental(tie_points.left, tie_points.right), tie_points)
        reasons.append(
            f"rows disagree: expected a 95th percentile of the row error up to {params.row_error_limit_px:g} px, got "
            f"{p95:.2f} px (median {median:.2f} px, {len(tie_points)} tie points)"
        )
    for side, view in zip(("left", "right"), views, strict=True):
        shape = homography_distortion(view.homography, tie_points.width, tie_points.height)
        reasons += _torn_or_bent(side, shape, params) + _rolled(side, view)
    return reasons


def flatness_warnings(tie_points: TiePoints, params: RectifyParams) -> tuple[Finding, ...]:
    """A finding where one homography explains nearly all tie points; else none."""
    share = homography_share(tie_points, 2 * params.tie_threshold_px)
    if share <= params.flat_share_limit:
        return ()
    return (
        Finding(
            Code.RECTIFY_FLAT_SCENE,
            f"flat scene: one homography explains {share:.0%} of {len(tie_points)} tie points (limit "
            f"{params.flat_share_limit:.0%}): rows agree on this surface, elsewhere they need not",
        ),
    )
