"""What a rectification is: two views, the maps that warp images into them, and the geometry they share."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from uw_recon_ros.rectify.rectified_camera import RectifiedCamera
from uw_recon_ros.rectify.tie_points import TiePoints
from uw_recon_ros.rectify.warp import beyond_image
from uw_recon_ros.types import FloatImage, Mask, Matrix, RectificationQuality, StereoGeometry, Window

_NEARLY_ALL = 0.95


@dataclass(frozen=True, eq=False)
class Rectification:
    """Everything needed to warp the images of one rig.

    Parameters
    ----------
    left, right : RectifiedCamera
        Rectified pixels are those of the output images, after cropping.
    raw_width, raw_height : int
        Size of the images that go in, px.
    width, height : int
        Size of either rectified image, px.
    geometry : StereoGeometry
        Principal points after cropping.
    quality : RectificationQuality
    left_map, right_map : (height, width, 2) float32 or None
        Raw pixel (u, v) of every rectified pixel; None: the images came rectified and stay as they are.
    valid_left, valid_right : Window or None
        Where the rectified images show something; None: everywhere.
    infinity_sigma_px : float
        Uncalibrated: standard deviation of the disparity at infinity, as far as noise goes, px; else NaN.
    flat : bool
        Uncalibrated: one homography explains the scene, so that it does not fix the geometry.
    locked : bool
        Whether a rig's geometry is settled, see `RigTracker`.
    """

    left: RectifiedCamera
    right: RectifiedCamera
    raw_width: int
    raw_height: int
    width: int
    height: int
    geometry: StereoGeometry
    quality: RectificationQuality
    left_map: FloatImage | None = None
    right_map: FloatImage | None = None
    valid_left: Window | None = None
    valid_right: Window | None = None
    infinity_sigma_px: float = float("nan")
    flat: bool = False
    locked: bool = False

    @cached_property
    def outside(self) -> tuple[Mask | None, Mask | None]:
        """Where the left and the right map point beyond the raw image; None where there is no map."""
        left, right = (
            None if raw_from_rect is None else beyond_image(raw_from_rect, self.raw_height, self.raw_width)
            for raw_from_rect in (self.left_map, self.right_map)
        )
        return left, right

    def rectified(self, tie_points: TiePoints) -> tuple[Matrix, Matrix]:
        """Rectified pixels of tie points, two of (N, 2) float64."""
        return self.left.rectified(tie_points.left), self.right.rectified(tie_points.right)

    def row_errors(self, tie_points: TiePoints) -> Matrix:
        """Left minus right coordinate across the baseline, (N,) float64, px; NaN where a point leaves the view."""
        left, right = self.rectified(tie_points)
        across = 1 if self.geometry.axis == "horizontal" else 0
        errors: Matrix = left[:, across] - right[:, across]
        return errors

    def parallax(self, tie_points: TiePoints) -> Matrix:
        """Disparity plus offset, (N,) float64, px: ``f B / Z``, so of the baseline's sign."""
        left, right = self.rectified(tie_points)
        along = 0 if self.geometry.axis == "horizontal" else 1
        parallax: Matrix = left[:, along] - right[:, along] + self.geometry.offset_px
        return parallax

    def with_quality(self, quality: RectificationQuality) -> Rectification:
        """The same rectification, judged anew."""
        return replace(self, quality=quality)


def behind(rectification: Rectification, tie_points: TiePoints) -> Mask:
    """Which tie points lie behind the rig, (N,) bool; those that left the view are left out."""
    parallax = rectification.parallax(tie_points) * rectification.geometry.baseline_sign
    found: Mask = parallax[np.isfinite(parallax)] < 0
    return found


def exchanged(rectification: Rectification, tie_points: TiePoints) -> bool:
    """Whether nearly all that both cameras see lies behind the rig: then they are exchanged."""
    found = behind(rectification, tie_points)
    return len(found) > 0 and bool(found.mean() >= _NEARLY_ALL)


def row_statistics(errors: Matrix) -> tuple[float, float]:
    """Median and 95th percentile of the magnitude, px; points that left the view count as infinite."""
    if not len(errors):
        return float("nan"), float("nan")
    magnitude = np.where(np.isfinite(errors), np.abs(errors), np.inf)
    low, high = np.quantile(magnitude, [0.5, 0.95], method="higher")
    return float(low), float(high)
