"""What fusion needs of a frame, as a user hands it over and as kernels take it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from uw_recon_ros import rigid
from uw_recon_ros.trajectory import DisparityFrame
from uw_recon_ros.types import ByteImage, FloatImage, Matrix


@dataclass(frozen=True, eq=False)
class PosedFrame:
    """A rectified left view, its depth, and where it was taken.

    Parameters
    ----------
    stamp_ns : int
    left : (H, W, 3) uint8
        RGB, rectified.
    depth, sigma : (H, W) float32
        Along the optical axis and its standard deviation, m (baselines where not metric); NaN = invalid.
    lens : (4,) float64
        Focal lengths across columns and rows, principal point; px.
    pose : (4, 4) float64
        World <- left rectified optical frame, m, less an origin; z is up.
    """

    stamp_ns: int
    left: ByteImage
    depth: FloatImage
    sigma: FloatImage
    lens: Matrix
    pose: Matrix

    def __post_init__(self) -> None:
        size = self.depth.shape
        if self.depth.ndim != 2 or self.sigma.shape != size or self.left.shape != (*size, 3):
            raise ValueError(
                "left, depth, sigma: expected (H, W, 3), (H, W), (H, W), "
                f"got {self.left.shape}, {size}, {self.sigma.shape}"
            )
        if self.pose.shape != (4, 4) or not np.isfinite(self.pose).all():
            raise ValueError(f"pose: expected a finite (4, 4) matrix, got {self.pose.tolist()}")


def posed_frame(
    frame: DisparityFrame, pose: Matrix, lens: Matrix, focal_times_baseline: float, offset_px: float
) -> PosedFrame:
    """A frame as it is fused.

    Parameters
    ----------
    frame : DisparityFrame
    pose : (4, 4) float64
        World <- left rectified view.
    lens : (4,) float64
        Focal lengths across columns and rows, principal point; px.
    focal_times_baseline, offset_px : float
        Depth is the first over the disparity and the second.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = focal_times_baseline / (frame.disparity.astype(np.float64) + offset_px)
        depth = np.where((depth > 0) & np.isfinite(depth), depth, np.nan)
        sigma = depth**2 / abs(focal_times_baseline) * frame.sigma
    return PosedFrame(frame.stamp_ns, frame.left, depth.astype(np.float32), sigma.astype(np.float32), lens, pose)


@dataclass(frozen=True, eq=False)
class View:
    """A frame as kernels take it.

    Parameters
    ----------
    lens : (4,) float64
        Focal lengths across columns and rows, principal point; px.
    motion : (3, 4) float64
        Camera <- world.
    depth, sigma : (H, W) float32
        NaN = invalid, in both.
    """

    lens: Matrix
    motion: Matrix
    depth: FloatImage
    sigma: FloatImage

    @property
    def position(self) -> Matrix:
        """(3,) of the camera in the world, m."""
        place: Matrix = -self.motion[:, :3].T @ self.motion[:, 3]
        return place


def view_of(frame: PosedFrame, sigma_limit: float = np.inf) -> View:
    """A frame without the pixels whose sigma is unknown or above a limit (m)."""
    with np.errstate(invalid="ignore"):
        good = (frame.depth > 0) & (frame.sigma > 0) & (frame.sigma <= sigma_limit)
    depth, sigma = (
        np.where(good, image, np.float32(np.nan)).astype(np.float32) for image in (frame.depth, frame.sigma)
    )
    return View(
        np.ascontiguousarray(frame.lens, np.float64), np.ascontiguousarray(rigid.inverse(frame.pose)[:3]), depth, sigma
    )
