"""How good a rectification is: distortion of the images, epipoles, flat scenes; and when to refuse it."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from uw_recon_ros.findings import Code, Finding, Severity
from uw_recon_ros.rectify.fundamental import epipole_inside, epipoles, fit_fundamental
from uw_recon_ros.rectify.params import RectifyParams
from uw_recon_ros.rectify.rectified_camera import RectifiedCamera, Views
from uw_recon_ros.rectify.sampson import homogeneous
from uw_recon_ros.rectify.tie_points import TiePoints
from uw_recon_ros.types import Matrix

_ROLL_LIMIT_DEG = 60.0
_PARTS, _SAME_EPIPOLE = 6, 0.15  # fits that must agree on the epipole; within that share of the diagonal
_SMALLEST_LIMIT_PX = 2.0  # tie points are not placed better in a smaller image
_MOST_NOISE = 2.0  # times that: noisier tie points are no tie points
_NOISE_SLACK = 4.4  # 95th percentile over median of normal noise, 2.9, and half as much again


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


def _torn_or_bent(side: str, distortion: Distortion, params: RectifyParams) -> list[Finding]:
    low, high = 1 / params.aspect_limit, params.aspect_limit
    straight = abs(distortion.angle_deg - 90) <= params.angle_limit_deg
    if straight and low <= distortion.aspect <= high and low <= distortion.diagonals <= high:
        return []
    text = (
        f"the {side} image would be distorted: expected aspect and diagonals {low:.2f} to {high:.2f} and an angle of "
        f"90 +- {params.angle_limit_deg:g} deg, got {distortion}"
    )
    return [Finding(Code.RECTIFY_DISTORTED, text, Severity.REFUSED)]


def forward_motion(tie_points: TiePoints) -> list[Finding]:
    """A refusal where an epipole lies in its image, whichever part of the tie points is asked; else none.

    Noise, a flat scene or an unmodelled lens put the epipole of one fit anywhere; of several fits to random parts of
    the tie points they scatter it, and then nothing is said of the motion.
    """
    size = tie_points.width, tie_points.height
    found = _epipoles_of_parts(tie_points)
    for number, side in enumerate(("left", "right")):
        places = [pair[number] for pair in found]
        if not places or not all(epipole_inside(place, *size) for place in places):
            continue
        pixels = np.array([place[:2] / place[2] for place in places])
        u, v = np.median(pixels, axis=0)
        if np.abs(pixels - [u, v]).max() < _SAME_EPIPOLE * float(np.hypot(*size)):
            text = (
                f"forward motion: the epipole lies in the {side} image, at ({u:.0f}, {v:.0f}) of {size[0]}x{size[1]} "
                "px; expected cameras side by side or one above the other"
            )
            return [Finding(Code.RECTIFY_FORWARD_MOTION, text, Severity.REFUSED)]
    return []


def _epipoles_of_parts(tie_points: TiePoints) -> list[tuple[Matrix, Matrix]]:
    """Of the fit to all tie points, and of fits to random halves; only the first where that settles it."""
    size = tie_points.width, tie_points.height
    whole = epipoles(fit_fundamental(tie_points.left, tie_points.right))
    if not any(epipole_inside(epipole, *size) for epipole in whole):
        return []
    rng = np.random.default_rng(0)
    halves = [rng.permutation(len(tie_points))[: max(len(tie_points) // 2, 8)] for _ in range(_PARTS)]
    return [whole, *(epipoles(fit_fundamental(tie_points.left[half], tie_points.right[half])) for half in halves)]


def _rolled(side: str, view: RectifiedCamera) -> list[Finding]:
    roll = float(np.degrees(np.arctan2(view.r[1, 0], view.r[0, 0])))
    if abs(roll) <= _ROLL_LIMIT_DEG:
        return []
    text = f"the {side} image would be turned by {roll:.0f} deg: is the baseline along the other axis (rig_axis)?"
    return [Finding(Code.RECTIFY_DISTORTED, text, Severity.REFUSED)]


def row_limit_px(params: RectifyParams, tie_points: TiePoints, noise_px: float) -> float:
    """95th percentile over which an estimate is refused: of the image's size, 2 px, or of the noise: the largest."""
    diagonal = float(np.hypot(tie_points.width, tie_points.height))
    of_size = max(1e-3 * params.row_error_limit_permille * diagonal, _SMALLEST_LIMIT_PX)
    of_noise = 0.0 if np.isnan(noise_px) else _NOISE_SLACK * noise_px
    return max(of_size, min(of_noise, _MOST_NOISE * of_size))


def refusals(
    views: Views,
    tie_points: TiePoints,
    row_error: tuple[float, float],
    params: RectifyParams,
    noise_px: float = float("nan"),
) -> list[Finding]:
    """Reasons not to use a rectification, with the numbers; none if it is sound.

    Parameters
    ----------
    views : (RectifiedCamera, RectifiedCamera)
        Left and right.
    tie_points : TiePoints
    row_error : (float, float)
        Median and 95th percentile, px.
    params : RectifyParams
        The limits.
    noise_px : float
        Median magnitude of the tie points' own noise along rows; NaN: not known.
    """
    median, p95 = row_error
    limit = row_limit_px(params, tie_points, noise_px)
    reasons: list[Finding] = []
    if not p95 <= limit:
        text = (
            f"vertical (epipolar) error: expected a 95th percentile up to {limit:.2f} px, got "
            f"{p95:.2f} px (median {median:.2f} px, {len(tie_points)} tie points)"
        )
        reasons.append(Finding(Code.RECTIFY_ROWS_DISAGREE, text, Severity.REFUSED))
    for side, view in zip(("left", "right"), views, strict=True):
        shape = homography_distortion(view.homography, tie_points.width, tie_points.height)
        reasons += _torn_or_bent(side, shape, params) + _rolled(side, view)
    return forward_motion(tie_points) + reasons if reasons else []


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
