"""The planes of the frame before, moved to where their surfaces are now.

They are proposals like others: what does not fit the new pair any more loses to what does. So nothing is carried on
that the images do not bear out, and a wrong motion costs time, not accuracy.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from uw_recon_ros.types import ByteImage, FloatImage, Mask

SPACING = 16  #: between the points whose motion is measured, px of the small images
WIDEST = 640  #: px; larger images are made smaller to measure motion
_WINDOW = (15, 15)
_LEVELS = 4  # of the pyramid: motions up to about 7 px times two to the fourth
_MOST_DIFFERENT = 20.0  # gray levels, mean over the window: more is no match
_LEAST_FOUND = 0.25  # share of the points; with fewer the frames show different things
_ALIKE = 2.0  # px: only disparities this near to a moved plane tell how its surface came nearer
_AROUND = 31  # px: window over which that is averaged


class FrameBefore(NamedTuple):
    """What is kept of a frame.

    Parameters
    ----------
    gray : (H, W) uint8
        Left image.
    planes : (3, H, W) float32
        a, b, c of the disparity ``a u + b v + c`` of every pixel.
    """

    gray: ByteImage
    planes: FloatImage


def move_planes(before: FrameBefore, gray: ByteImage, disparity: FloatImage, usable: Mask) -> FloatImage | None:
    """Planes of the frame before at the places where their surfaces are now.

    Parameters
    ----------
    before : FrameBefore
    gray : (H, W) uint8
        Left image now.
    disparity : (H, W) float32
        A first map of it, px, to be trusted where `usable` (H, W) bool says.

    Returns
    -------
    (3, H, W) float32 or None
        NaN where nothing is known; None: the frames have too little in common.
    """
    flow = _measure_flow(gray, before.gray)
    if flow is None:
        return None
    height, width = gray.shape
    v, u = np.indices((height, width), np.float32)
    then_u, then_v = u + flow[..., 0], v + flow[..., 1]
    maps = cv2.convertMaps(then_u, then_v, cv2.CV_16SC2, nninterpolation=True)
    nan, border = float("nan"), cv2.BORDER_CONSTANT
    a, b, c = (
        np.asarray(cv2.remap(plane, *maps, cv2.INTER_NEAREST, borderMode=border, borderValue=nan), np.float32)
        for plane in before.planes
    )
    d = a * then_u + b * then_v + c
    d += _approach(disparity - d, usable)
    return np.stack([a, b, d - a * u - b * v]).astype(np.float32)


def _measure_flow(now: ByteImage, before: ByteImage) -> FloatImage | None:
    """From every pixel now to its place before, (H, W, 2), px."""
    height, width = now.shape
    shrink = max(1, -(-width // WIDEST))
    size = max(width // shrink, 1), max(height // shrink, 1)
    if min(size) < 2 * SPACING:
        return None
    here, there = (i if shrink == 1 else cv2.resize(i, size, interpolation=cv2.INTER_AREA) for i in (now, before))
    v, u = np.mgrid[SPACING // 2 : size[1] : SPACING, SPACING // 2 : size[0] : SPACING].astype(np.float32)
    points = np.stack([u, v], axis=-1).reshape(-1, 1, 2)
    ends, status, error = cv2.calcOpticalFlowPyrLK(
        here, there, points, points.copy(), winSize=_WINDOW, maxLevel=_LEVELS
    )
    found = (np.asarray(status).ravel() == 1) & (np.asarray(error).ravel() < _MOST_DIFFERENT)
    if found.mean() < _LEAST_FOUND:
        return None
    motion = np.where(found[:, None], (np.asarray(ends) - points).reshape(-1, 2), np.float32(np.nan))
    return _dense(_smooth(motion.astype(np.float32).reshape(*u.shape, 2)), size, (height, width), shrink)


def _smooth(grid: FloatImage) -> FloatImage:
    """The median of each point and its neighbours; of all, where none of them is known."""
    padded = np.pad(grid, ((1, 1), (1, 1), (0, 0)), constant_values=np.nan)
    rows, columns, _ = grid.shape
    around = np.stack([padded[i : i + rows, j : j + columns] for i in range(3) for j in range(3)])
    known = np.isfinite(around)
    around = np.sort(np.where(known, around, np.float32(np.inf)), axis=0)
    middle = (known.sum(axis=0).clip(1) - 1) // 2
    median = np.take_along_axis(around, middle[None], axis=0)[0]
    return np.where(np.isfinite(median), median, np.nanmedian(grid, axis=(0, 1))).astype(np.float32)


def _dense(grid: FloatImage, size: tuple[int, int], shape: tuple[int, int], shrink: int) -> FloatImage:
    """The motion of all pixels from that of the points."""
    full = cv2.resize(grid, (grid.shape[1] * SPACING, grid.shape[0] * SPACING), interpolation=cv2.INTER_LINEAR)
    full = full[: size[1], : size[0]]
    if shrink > 1:
        full = cv2.resize(full, (shape[1], shape[0]), interpolation=cv2.INTER_LINEAR) * np.float32(shrink)
    return np.asarray(full, np.float32)


def _approach(difference: FloatImage, usable: Mask) -> FloatImage:
    """By how much surfaces came nearer, px: the mean of what agrees around a pixel."""
    agrees = (usable & (np.abs(difference) < _ALIKE)).astype(np.float32)
    window = (_AROUND, _AROUND)
    count = cv2.boxFilter(agrees, -1, window, normalize=False)
    total = cv2.boxFilter(np.where(agrees > 0, difference, np.float32(0)), -1, window, normalize=False)
    return np.asarray(total / np.maximum(count, 1), np.float32)
