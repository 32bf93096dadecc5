"""Partners that are not of one moment: where the right camera was when it took its image, seen from the left one.

Between the left image and the right one, `lag_s` later, the rig moved: the baseline of such a pair is ``b + v lag``,
and its rows are off by what the rig turned. The left image's neighbours in time tell how the rig moved
(Longuet-Higgins and Prazdny, 1980), the pair's tie points how far its scene is. So the right view is turned back to
where the left one looked, which brings the rows together, and disparities become those of the rig as it was calibrated.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros import rigid
from uw_recon_ros.rectify.rectification import Rectification
from uw_recon_ros.rectify.rectified_camera import RectifiedCamera
from uw_recon_ros.rectify.tie_points import TiePoints
from uw_recon_ros.rectify.warp import make_canvas
from uw_recon_ros.types import ByteImage, DisparityMap, Matrix, StereoGeometry

_FEWEST = 25  # points that a motion is fitted to
_PATCH, _LEVELS = 15, 4  # of the following: side, px, and halvings
_BACK_PX = 0.5  # a point followed there and back must arrive this near
_FINEST_PX = 0.1  # points are not followed better
_SHARED = 2.0  # measured: residuals of neighbouring points have errors in common
_ROUNDS = 2  # depths come from a baseline that the motion changes
#: What a rig may do that nobody saw, m/s: where its motion is not known, disparities are less sure by so much.
UNSEEN_SPEED = 0.2


@dataclass(frozen=True, eq=False)
class Moments:
    """A pair whose images were not taken at one moment.

    Parameters
    ----------
    lag_s : float
        The right image was taken so much later than the left one.
    left : (H, W) uint8
        Raw left image, gray.
    neighbours : sequence of (float, (H, W) uint8)
        Those taken before and after it, s from it.
    """

    lag_s: float
    left: ByteImage
    neighbours: Sequence[tuple[float, ByteImage]] = ()


@dataclass(frozen=True, eq=False)
class RigMotion:
    """How a rig moves at a moment.

    Parameters
    ----------
    twist : (6,) float64
        Of the left rectified view in its own axes, m/s and rad/s; in baselines where the scale is not known.
    covariance : (6, 6) float64
    points : int
    """

    twist: Matrix
    covariance: Matrix
    points: int


@dataclass(frozen=True, eq=False)
class LateRight:
    """Where the right view of a pair was.

    Parameters
    ----------
    centre : (3,) float64
        Of the right camera, in the left rectified view's axes, m.
    nominal : float
        What its first component (second, of a vertical rig) is in a pair of one moment, m.
    sigma : float
        Standard deviation of that component, m.
    scale : float
        Focal length of the right view by that of the left one.
    """

    centre: Matrix
    nominal: float
    sigma: float
    scale: float = 1.0

    @property
    def moved(self) -> float:
        """What the baseline of this pair is longer, m."""
        along = int(np.argmax(np.abs(self.centre)))
        return float(np.sign(self.nominal) * (self.centre[along] - self.nominal))


def find_motion(moments: Moments, tie_points: TiePoints, rectification: Rectification) -> RigMotion | None:
    """How the rig moves, by what the left camera saw before and after.

    Parameters
    ----------
    moments : Moments
    tie_points : TiePoints
        Of the pair, raw px.
    rectification : Rectification
        The rig's, of one moment.

    Returns
    -------
    RigMotion or None
        None: too few points can be followed.
    """
    tracks = _followed(moments, tie_points, rectification)
    if tracks is None:
        return None
    here, right, flow, seconds = tracks
    motion: RigMotion | None = None
    for _ in range(_ROUNDS):
        late = _late(motion, moments.lag_s, rectification.geometry)
        inverse_depth = _inverse_depths(here, right, rectification.geometry, late, motion, moments.lag_s)
        motion = _fitted(here, flow, inverse_depth, seconds, rectification.geometry)
        if motion is None:
            return None
    return motion


def turned_back(
    rectification: Rectification, motion: RigMotion, lag_s: float, tie_points: TiePoints
) -> tuple[Rectification, LateRight]:
    """The rig's rectification for a late right image, and where the right camera was.

    Parameters
    ----------
    rectification : Rectification
        Of a calibrated rig without ports.
    motion : RigMotion
    lag_s : float
    tie_points : TiePoints
        Of the pair; tell the depth at which its rows agree best.
    """
    geometry, right = rectification.geometry, rectification.right
    if not isinstance(right, RectifiedCamera):
        raise TypeError(f"rectification: expected a right view without a port, got {type(right).__name__}")
    late = _late(motion, lag_s, geometry)
    along = _along(geometry)
    here, there = rectification.rectified(tie_points)
    depth = 1 / float(np.nanmedian(_inverse_depths(here, there, geometry, late, motion, lag_s)))
    turned = rigid.exp(motion.twist * lag_s)[:3, :3] @ right.r
    scale = (depth - late.centre[2]) / depth
    k = right.k_new.copy()
    k[:2, :2] *= scale
    k[1 - along, 2] += right.k_new[1 - along, 1 - along] * late.centre[1 - along] / depth
    view = replace(right, r=turned, k_new=k)
    size = rectification.raw_width, rectification.raw_height
    canvas = make_canvas(view, rectification.width, rectification.height, *size)
    moved = replace(rectification, right=view, right_map=canvas.raw_from_rect)
    return moved, replace(late, scale=scale)


def of_one_moment(found: DisparityMap, late: LateRight | None, lag_s: float) -> DisparityMap:
    """Disparities as if both images had been taken at the left one's moment.

    Parameters
    ----------
    found : DisparityMap
        Of the views that `turned_back` makes, where `late` is known.
    late : LateRight or None
        None: nobody knows how the rig moved; disparities stay and are less sure.
    lag_s : float
    """
    geometry = found.geometry
    parallax = found.disparity.astype(np.float64) + geometry.offset_px
    base = abs(geometry.focal_times_baseline) / geometry.focal_px
    if late is None:
        unsure = np.hypot(found.sigma, np.abs(parallax) * UNSEEN_SPEED * abs(lag_s) / base)
        return replace(found, sigma=unsure.astype(np.float32))
    along = _along(geometry)
    grid = np.arange(found.disparity.shape[1 - along], dtype=np.float64)
    rays = _rays(grid if along == 0 else grid[:, None], geometry)
    off = (rays * geometry.focal_px - parallax) / (late.scale * geometry.focal_px)  # of the right view's axis
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse_depth = (rays - off) / (late.centre[along] - off * late.centre[2])
        mended = geometry.focal_px * late.nominal * inverse_depth - geometry.offset_px
    stretch = abs(late.nominal / late.centre[along])
    unsure = np.hypot(found.sigma * stretch, np.abs(parallax) * late.sigma / abs(late.nominal))
    there = np.isfinite(found.disparity)
    return replace(
        found, disparity=np.where(there, mended, np.nan).astype(np.float32),
        sigma=np.where(there, unsure, np.nan).astype(np.float32),
    )  # fmt: skip


def _along(geometry: StereoGeometry) -> int:
    return 0 if geometry.axis == "horizontal" else 1


def _rays(pixels: Matrix, geometry: StereoGeometry) -> Matrix:
    """Of the left view, along the baseline."""
    found: Matrix = (pixels - geometry.cx_left) / geometry.focal_px
    return found


def _late(motion: RigMotion | None, lag_s: float, geometry: StereoGeometry) -> LateRight:
    """Where the right camera was; without a motion, where it always is."""
    along = _along(geometry)
    nominal = geometry.focal_times_baseline / geometry.focal_px
    base = np.zeros(3)
    base[along] = nominal
    if motion is None:
        return LateRight(base, nominal, 0.0)
    moved = rigid.exp(motion.twist * lag_s)
    sigma = abs(lag_s) * float(np.sqrt(motion.covariance[along, along]))
    return LateRight(moved[:3, :3] @ base + moved[:3, 3], nominal, sigma)


def _inverse_depths(
    here: Matrix, right: Matrix, geometry: StereoGeometry, late: LateRight, motion: RigMotion | None, lag_s: float
) -> Matrix:
    """(N,) 1/m of tie points, rectified by the rig's rectification of one moment."""
    along = _along(geometry)
    k = geometry.intrinsics_left
    left_rays = np.column_stack([(here - k[[0, 1], 2]) / k[[0, 1], [0, 1]], np.ones(len(here))])
    middle = np.array([k[0, 2], k[1, 2]])
    middle[along] = geometry.cx_right
    right_rays = np.column_stack([(right - middle) / k[[0, 1], [0, 1]], np.ones(len(right))])
    if motion is not None:
        right_rays = right_rays @ rigid.exp(motion.twist * lag_s)[:3, :3].T
    off = right_rays[:, along] / right_rays[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        found: Matrix = (left_rays[:, along] - off) / (late.centre[along] - off * late.centre[2])
    return found


def _followed(
    moments: Moments, tie_points: TiePoints, rectification: Rectification
) -> tuple[Matrix, Matrix, Matrix, float] | None:
    """Rectified places (N, 2) in the left and the right view, flow (N, 2) over some seconds, px, and these."""
    raw = tie_points.left.astype(np.float32)
    ends: list[tuple[float, Matrix]] = []
    known = np.ones(len(raw), np.bool_)
    for seconds, image in moments.neighbours:
        there, seen = _follow(moments.left, image, raw)
        known &= seen
        ends.append((seconds, rectification.left.rectified(there.astype(np.float64))))
    here, right = rectification.rectified(tie_points)
    if len(ends) == 1:
        ends.append((0.0, here))
    if not ends:
        return None
    (first, one), (last, other) = sorted(ends, key=lambda end: end[0])
    flow = other - one
    known &= np.isfinite(flow).all(axis=1) & np.isfinite(here).all(axis=1) & np.isfinite(right).all(axis=1)
    if known.sum() < _FEWEST or last <= first:
        return None
    return here[known], right[known], flow[known], last - first


def _follow(first: ByteImage, second: ByteImage, points: NDArray[np.float32]) -> tuple[Matrix, NDArray[np.bool_]]:
    def one_way(a: ByteImage, b: ByteImage, at: NDArray[np.float32]) -> tuple[NDArray[np.float32], NDArray[np.bool_]]:
        found, status, _ = cv2.calcOpticalFlowPyrLK(a, b, at, None, winSize=(_PATCH, _PATCH), maxLevel=_LEVELS)  # type: ignore[call-overload]
        return np.asarray(found, np.float32).reshape(-1, 2), np.asarray(status).ravel() == 1

    if not len(points):
        return np.zeros((0, 2)), np.zeros(0, np.bool_)
    there, gone = one_way(first, second, points)
    back, returned = one_way(second, first, there)
    return there.astype(np.float64), gone & returned & (np.abs(back - points).max(axis=1) < _BACK_PX)


def _fitted(
    here: Matrix, flow: Matrix, inverse_depth: Matrix, seconds: float, geometry: StereoGeometry
) -> RigMotion | None:
    """The motion that the flow of most points agrees on, by reweighted least squares."""
    k = geometry.intrinsics_left
    x, y = ((here - k[[0, 1], 2]) / k[[0, 1], [0, 1]]).T
    w, zero, one = inverse_depth, np.zeros_like(x), np.ones_like(x)
    design = np.stack([
        np.stack([-w, zero, x * w, x * y, -(one + x * x), y], axis=1) * k[0, 0],
        np.stack([zero, -w, y * w, one + y * y, -x * y, -x], axis=1) * k[1, 1],
    ], axis=1)  # fmt: skip
    kept = np.isfinite(w) & (w > 0)
    measured, weights = flow / seconds, np.ones(len(w))
    for _ in range(10):
        if kept.sum() < _FEWEST:
            return None
        rows, values = design[kept].reshape(-1, 6), measured[kept].ravel()
        scaled = np.repeat(np.sqrt(weights[kept]), 2)
        twist, *_ = np.linalg.lstsq(rows * scaled[:, None], values * scaled, rcond=None)
        rest = np.linalg.norm(measured - design @ twist, axis=1)
        noise = max(float(1.2 * np.median(rest[kept])) / np.sqrt(2), _FINEST_PX / seconds)
        weights = np.minimum(1.0, 2 * noise / np.maximum(rest, 1e-12))
        kept = np.isfinite(w) & (w > 0) & (rest < 6 * noise)
    if kept.sum() < max(_FEWEST, len(w) // 2):
        return None
    information = np.einsum("n,nij,nik->jk", weights[kept], design[kept], design[kept]) / noise**2
    covariance = _SHARED**2 * np.linalg.pinv(information)
    return RigMotion(twist, covariance, int(kept.sum()))
