"""Corners followed by optical flow: for frames that come one soon after the other; far cheaper than descriptors."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.track.keypoints import Keypoints, equalised, find_keypoints, sampled, with_disparity
from uw_recon_ros.track.params import TrackParams
from uw_recon_ros.track.relate import KeyPointMatches, expected_places
from uw_recon_ros.trajectory import DisparityFrame
from uw_recon_ros.types import ByteImage, FloatImage, Matrix, StereoGeometry

_APART_PX, _QUALITY = 8, 0.005  # between corners; of the best corner's strength
_LEVELS = 4  # of the pyramid: sixteen times the window may be crossed
_THERE_AND_BACK_PX = 0.7
_AS_OFFLINE = TrackParams(keypoints=700, clahe_clip=0.0)  # of the equalised view


@dataclass(frozen=True, eq=False)
class Corners:
    """What the odometry keeps of a frame.

    Parameters
    ----------
    gray : (H, W) uint8
        Left view, its contrast equalised.
    disparity, sigma : (H, W) float32
        px; NaN = invalid.
    measured : (N, 3) float64
        Corners: u, v, disparity; px.
    spread : (N,) float64
        Standard deviation of their disparities, px.
    geometry : StereoGeometry
    """

    gray: ByteImage
    disparity: FloatImage
    sigma: FloatImage
    measured: Matrix
    spread: Matrix
    geometry: StereoGeometry

    @cached_property
    def keypoints(self) -> Keypoints:
        """Key points with descriptors, for when flow does not find the way; made when they are asked for."""
        return find_keypoints(self.gray, self.disparity, self.sigma, _AS_OFFLINE)


def find_corners(frame: DisparityFrame, count: int, clahe_clip: float) -> Corners:
    """Find the strongest corners that have a disparity, at most `count`, spread over the view."""
    gray = equalised(frame.left, clahe_clip)
    known = with_disparity(frame.disparity, frame.sigma)
    found = cv2.goodFeaturesToTrack(gray, count, _QUALITY, _APART_PX, mask=known)
    places = np.zeros((0, 2)) if found is None else np.asarray(found, np.float64).reshape(-1, 2)
    measured, spread = _measured(places, frame.disparity, frame.sigma)
    kept = np.isfinite(measured[:, 2]) & np.isfinite(spread)
    return Corners(gray, frame.disparity, frame.sigma, measured[kept], spread[kept], frame.geometry)


def _measured(places: Matrix, disparity: FloatImage, sigma: FloatImage) -> tuple[Matrix, Matrix]:
    return np.column_stack([places, sampled(disparity, places)]), sampled(sigma, places)


def follow(first: Corners, second: Corners, window_px: int, guess: Matrix | None = None) -> KeyPointMatches:
    """Follow the first frame's corners into the second, and back again.

    Parameters
    ----------
    first, second : Corners
    window_px : int
        Side of the patch about a corner.
    guess : (4, 4) float64, optional
        First <- second: where to begin.
    """
    start = first.measured[:, :2].astype(np.float32).reshape(-1, 1, 2)
    if not len(start):
        return KeyPointMatches(first.measured, first.measured, first.spread, first.spread)
    begin = start.copy()
    if guess is not None:
        begin[:, 0] = expected_places(first.measured, second.geometry, guess)
    begin = np.where(np.abs(begin) < 1e5, begin, start).astype(np.float32)
    there, seen = _flow(first.gray, second.gray, start, begin, window_px, _LEVELS)
    back, again = _flow(second.gray, first.gray, there, start, window_px, 1)
    good = seen & again & (np.linalg.norm(back - start, axis=2)[:, 0] < _THERE_AND_BACK_PX)
    places = there.astype(np.float64).reshape(-1, 2)
    height, width = second.gray.shape
    good &= ((places >= 0) & (places <= (width - 1, height - 1))).all(axis=1)
    measured, spread = _measured(places[good], second.disparity, second.sigma)
    known = np.isfinite(measured[:, 2]) & np.isfinite(spread)
    return KeyPointMatches(first.measured[good][known], measured[known], first.spread[good][known], spread[known])


def _flow(
    first: ByteImage, second: ByteImage, start: FloatImage, begin: FloatImage, window_px: int, levels: int
) -> tuple[FloatImage, NDArray[np.bool_]]:
    """Where corners (N, 1, 2) went, sought from `begin` on, and whether they were found (N,)."""
    there, seen, _ = cv2.calcOpticalFlowPyrLK(
        first, second, start, begin.copy(), winSize=(window_px, window_px), maxLevel=levels,
        flags=cv2.OPTFLOW_USE_INITIAL_FLOW,
    )  # fmt: skip
    return np.asarray(there, np.float32), np.asarray(seen).ravel() > 0
