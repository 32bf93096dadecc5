"""Both views made ready, and the semi-global start that every effort begins with."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from uw_recon_ros.masks import only_where
from uw_recon_ros.match.planes import semiglobal
from uw_recon_ros.match.planes.brightness import SHRINK, brightened, brightness_between
from uw_recon_ros.match.planes.gray import Gray, gray_pair
from uw_recon_ros.match.planes.left_right_check import fill_background, left_right_check
from uw_recon_ros.match.planes.thread_pool import row_bands, run_parallel
from uw_recon_ros.types import ByteImage, FloatImage, Mask

VOXEL_BYTES, MOST_BYTES = 3, 0.6e9  #: of the start's cost volume, and what it may take before images are made smaller
#: Voxels, and labels, from which on images of half the size are matched first and say where to search.
GUIDED, GUIDED_LABELS = 40e6, 64
ALONE = 5  #: side of the window whose median guides: what is alone in it is no surface, px of these


@dataclass(frozen=True, eq=False)
class View:
    """One image in the forms that are needed.

    Parameters
    ----------
    pixels : (H, W, C) uint8
        C = 1 or 3.
    planes : (C, H, W) uint8
    gray : (H, W) int16
        Of `gray.gray_pair`, as are `noise` and `grain`, those of both views: from 0 to 1, and over the contrast.
    """

    pixels: ByteImage
    planes: ByteImage
    gray: Gray
    noise: float
    grain: float

    @classmethod
    def pair(cls, left: ByteImage, right: ByteImage, threads: int) -> tuple[View, View]:
        """Both, made alike."""
        pixels = [np.ascontiguousarray(np.atleast_3d(image)) for image in (left, right)]
        *grays, noise, grain = gray_pair(pixels[0], pixels[1], threads)
        first, second = (
            cls(p, np.ascontiguousarray(p.transpose(2, 0, 1)), g, noise, grain)
            for p, g in zip(pixels, grays, strict=True)
        )
        return first, second

    def as_bytes(self) -> ByteImage:
        """Gray, (H, W)."""
        if self.pixels.shape[2] == 1:
            return self.pixels[..., 0]
        return np.asarray(cv2.cvtColor(self.pixels, cv2.COLOR_RGB2GRAY), np.uint8)


class Beginning(NamedTuple):
    """What a pair shows before any plane is tried.

    Parameters
    ----------
    images : two View
        Left and right.
    disparity : (H, W) float32
        Left view, px; never NaN.
    status : (H, W) uint8
        `Status` bits; 0 where both views agree.
    half : Beginning or None
        Of images of half the size, where it was made on the way.
    learned : bool
        Whether a network gave it, which can make up the same in both views.
    """

    images: tuple[View, View]
    disparity: FloatImage
    status: ByteImage
    half: Beginning | None = None
    learned: bool = False

    @property
    def usable(self) -> Mask:
        """Where both views agree."""
        return np.asarray(self.status == 0)


def begin(left: ByteImage, right: ByteImage, low: int, high: int, threads: int) -> Beginning:
    """Match a rectified pair at whole disparities, and compare both views.

    Of smaller images where the cost volume would not fit.

    Parameters
    ----------
    left, right : (H, W) or (H, W, 3) uint8
    low, high : int
        Limits of the disparity, inclusive, px.
    threads : int
        The result does not depend on it.
    """
    images = View.pair(left, right, threads)
    return Beginning(images, *_start(images, (low, high), threads))


def _start(
    images: tuple[View, View], limits: tuple[int, int], threads: int
) -> tuple[FloatImage, ByteImage, Beginning | None]:
    """The semi-global start and its status; of smaller images where the cost volume would not fit."""
    height, width = images[0].gray.shape
    shrink = 1
    while VOXEL_BYTES * height * width * (limits[1] - limits[0] + 1) / shrink**3 > MOST_BYTES:
        shrink *= 2
    left, right = images
    if shrink > 1:
        left, right = View.pair(_shrink(left.pixels, shrink), _shrink(right.pixels, shrink), threads)
    scale = width / left.gray.shape[1]
    small = math.floor(limits[0] / scale), math.ceil(limits[1] / scale)
    by, half, guide = _brightness(left, right, *small, threads), None, None
    labels = small[1] - small[0] + 1
    if labels > GUIDED_LABELS and labels * left.gray.size > GUIDED:
        half = _half(left, right, *small, by, threads)
        guide = _guide(half, left.gray.shape)
    start = _matched(left, right, *small, threads, brightened(right.planes, by), guide)
    status = compare_views(start.disparity, start.right, small, threads)
    if shrink == 1:
        return start.disparity, status, half
    status = np.asarray(cv2.resize(status, (width, height), interpolation=cv2.INTER_NEAREST), np.uint8)
    disparity = enlarge(start.disparity, (width, height), scale)
    return np.asarray(disparity.clip(*limits), np.float32), status, None


def _matched(
    left: View, right: View, low: int, high: int, threads: int, colors: ByteImage | None = None,
    guide: FloatImage | None = None,
) -> semiglobal.Start:  # fmt: skip
    """Semi-global disparities, with other `colors` of the right view where they are given."""
    planes = right.planes if colors is None else colors
    views = left.planes, planes, left.gray, right.gray
    return semiglobal.semiglobal_start(*views, left.noise, low, high, threads, guide)


def _brightness(left: View, right: View, low: int, high: int, threads: int) -> FloatImage:
    """How much brighter the left view is, for `brightened`."""
    smaller = View.pair(_shrink(left.pixels, SHRINK), _shrink(right.pixels, SHRINK), threads)
    limits = math.floor(low / SHRINK), math.ceil(high / SHRINK)
    return brightness_between(smaller[0].pixels, smaller[1].pixels, _matched(*smaller, *limits, threads))


def _half(left: View, right: View, low: int, high: int, by: FloatImage, threads: int) -> Beginning:
    """The start of images of half the size."""
    images = View.pair(_shrink(left.pixels, 2), _shrink(right.pixels, 2), threads)
    limits = math.floor(low / 2), math.ceil(high / 2)
    start = _matched(*images, *limits, threads, brightened(images[1].planes, by))
    return Beginning(images, start.disparity, compare_views(start.disparity, start.right, limits, threads))


def _guide(half: Beginning, shape: tuple[int, ...]) -> FloatImage:
    """Disparities to search near: where both views of half the size agree; the further surface's in between."""
    known = cv2.medianBlur(fill_background(only_where(half.usable, half.disparity)), ALONE)
    wide = cv2.resize(known, (shape[1], shape[0]), interpolation=cv2.INTER_NEAREST)
    return np.asarray(2 * wide, np.float32)


def compare_views(disparity: FloatImage, right: FloatImage, limits: tuple[int, int], threads: int) -> ByteImage:
    """`Status` of the left view's disparities, by the right view's; see `left_right_check`."""
    status = np.empty(disparity.shape, np.uint8)
    run_parallel(
        lambda b: left_right_check(disparity, right, *limits, *b, status),
        row_bands(disparity.shape[0], threads),
        threads,
    )
    return status


def enlarge(disparity: FloatImage, size: tuple[int, int], scale: float) -> FloatImage:
    """A map for images that are `scale` times as large: between its pixels on surfaces, never across their edges."""
    spread = cv2.dilate(disparity, np.ones((3, 3))) - cv2.erode(disparity, np.ones((3, 3)))
    even = cv2.resize((spread < 1).astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) == 1
    linear, nearest = (cv2.resize(disparity, size, interpolation=i) for i in (cv2.INTER_LINEAR, cv2.INTER_NEAREST))
    return np.asarray(np.where(even, linear, nearest) * np.float32(scale), np.float32)


def _shrink(image: ByteImage, factor: int) -> ByteImage:
    """Smaller by a factor, (H, W, C)."""
    size = max(image.shape[1] // factor, 1), max(image.shape[0] // factor, 1)
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), np.uint8).reshape(size[1], size[0], -1)
