"""Key points of a frame: RootSIFT on the enhanced left view, each with its disparity and how sure that is."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from uw_recon_ros.track.params import TrackParams
from uw_recon_ros.types import ByteImage, FloatImage, Matrix, StereoGeometry

_TILES = 8
# OpenCV doubles the image before it looks, and tells all places so much too large; 4.6, 4.10, 4.14 and 5.0 alike.
_SIFT_SHIFT_PX = 0.25


@dataclass(frozen=True, eq=False)
class Keypoints:
    """What is kept of a frame.

    Parameters
    ----------
    measured : (N, 3) float64
        u, v, disparity; px, left rectified view.
    sigma : (N,) float64
        Standard deviation of the disparity, px.
    descriptors : (N, 128) float32
        Unit length.
    """

    measured: Matrix
    sigma: Matrix
    descriptors: FloatImage

    def __len__(self) -> int:
        return len(self.sigma)


@dataclass(frozen=True, eq=False)
class PackedKeypoints:
    """Key points of a frame that is kept for long, in a quarter of the memory; made by `packed`.

    Parameters
    ----------
    measured : (N, 3) float32
    sigma : (N,) float32
    descriptors : (N, 128) uint8
        In steps of 1/512; RootSIFT's are hardly ever beyond a half.
    """

    measured: FloatImage
    sigma: FloatImage
    descriptors: ByteImage

    def unpacked(self) -> Keypoints:
        """As they were, but for rounding."""
        found = self.descriptors.astype(np.float32)
        length = np.maximum(np.linalg.norm(found, axis=1, keepdims=True), 1e-9)
        return Keypoints(self.measured.astype(np.float64), self.sigma.astype(np.float64), found / length)


def packed(keypoints: Keypoints, count: int) -> PackedKeypoints:
    """The first `count` of them."""
    descriptors = np.rint(512 * keypoints.descriptors[:count]).clip(0, 255).astype(np.uint8)
    measured, sigma = keypoints.measured[:count], keypoints.sigma[:count]
    return PackedKeypoints(measured.astype(np.float32), sigma.astype(np.float32), descriptors)


def thinned(keypoints: Keypoints, count: int) -> Keypoints:
    """The first `count` of them."""
    return Keypoints(keypoints.measured[:count], keypoints.sigma[:count], keypoints.descriptors[:count])


def equalised(left: ByteImage, clip: float) -> ByteImage:
    """Gray of an image (H, W) or (H, W, 3) RGB, its contrast equalised part by part (CLAHE)."""
    gray = left if left.ndim == 2 else np.asarray(cv2.cvtColor(left, cv2.COLOR_RGB2GRAY), np.uint8)
    return gray if clip <= 0 else np.asarray(cv2.createCLAHE(clip, (_TILES, _TILES)).apply(gray), np.uint8)


def find_keypoints(left: ByteImage, disparity: FloatImage, sigma: FloatImage, params: TrackParams) -> Keypoints:
    """Find key points that have a disparity.

    Parameters
    ----------
    left : (H, W) or (H, W, 3) uint8
        Enhanced left rectified view.
    disparity, sigma : (H, W) float32
        px; NaN = invalid.
    params : TrackParams

    Notes
    -----
    Which image is seen decides in mud: the enhanced one with CLAHE holds where the matcher's own lost every pair.
    """
    known = with_disparity(disparity, sigma)
    finder = cv2.SIFT.create(nfeatures=params.keypoints, contrastThreshold=0.01)
    points, found = finder.detectAndCompute(equalised(left, params.clahe_clip), known)
    if found is None or not len(points):
        return Keypoints(np.zeros((0, 3)), np.zeros(0), np.zeros((0, 128), np.float32))
    root = np.sqrt(found / np.maximum(found.sum(axis=1, keepdims=True), 1e-9)).astype(np.float32)
    pixels = np.array([point.pt for point in points], np.float64) - _SIFT_SHIFT_PX
    d, s = sampled(disparity, pixels), sampled(sigma, pixels)
    kept = np.isfinite(d) & np.isfinite(s)
    return Keypoints(np.column_stack([pixels, d])[kept], s[kept], root[kept])


def with_disparity(disparity: FloatImage, sigma: FloatImage) -> ByteImage:
    """(H, W) 1 where a disparity is known."""
    return (np.isfinite(disparity) & np.isfinite(sigma)).astype(np.uint8)


def sampled(image: FloatImage, pixels: Matrix) -> Matrix:
    """(N,) values of an image (H, W) at places (N, 2) px inside it: bilinear on one surface, nearest elsewhere."""
    u, v = np.floor(pixels).astype(int).T
    u, v = u.clip(0, image.shape[1] - 2), v.clip(0, image.shape[0] - 2)
    x, y = (pixels - np.stack([u, v], axis=1)).T
    corners = np.stack([image[v, u], image[v, u + 1], image[v + 1, u], image[v + 1, u + 1]]).astype(np.float64)
    weights = np.stack([(1 - x) * (1 - y), x * (1 - y), (1 - x) * y, x * y])
    smooth = np.ptp(corners, axis=0) < 1.0  # false where one is NaN
    nearest = np.take_along_axis(corners, weights.argmax(axis=0)[None], axis=0)[0]
    values: Matrix = np.where(smooth, (weights * corners).sum(axis=0), nearest)
    return values


@dataclass(frozen=True)
class RigError:
    """What a told rig is off by: `offset_px` is to be added to disparities, the focal length times ``1 + focal``."""

    offset_px: float = 0.0
    focal: float = 0.0


def points_of(measured: Matrix, geometry: StereoGeometry, error: RigError | None = None) -> Matrix:
    """(N, 3) points in the left rectified frame, m, of u, v, disparity (N, 3)."""
    fx, fy, cx, cy, fb, offset = constants(geometry, error or RigError())
    z = fb / (measured[:, 2] + offset)
    return np.stack([(measured[:, 0] - cx) / fx * z, (measured[:, 1] - cy) / fy * z, z], axis=1)


def constants(geometry: StereoGeometry, error: RigError) -> tuple[float, float, float, float, float, float]:
    """fx, fy, cx, cy (px), f B (px m), offset (px) of a rig, corrected."""
    k, share = geometry.intrinsics_left, 1 + error.focal
    offset = geometry.offset_px + error.offset_px
    return k[0, 0] * share, k[1, 1] * share, k[0, 2], k[1, 2], geometry.focal_times_baseline * share, offset
