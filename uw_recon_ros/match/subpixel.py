"""Disparities by what the images say in a window, without the smoothness that found them.

A matcher that prefers smooth surfaces flattens their relief by a few percent of a deviation from the plane: too little
to be seen in a surface, but over a whole dive it looks like an error of the rig. One step of Lucas and Kanade (1981) on
the right view, laid on the left one by the disparities that are there, takes that back where there is texture.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from uw_recon_ros.types import ByteImage, FloatImage
from uw_recon_ros.unseen_pixels import unseen

_WINDOW_PX = 9.0  # standard deviation of the window
_DOUBT = 16.0  # how many times the noise counts that independent pixels would have: snow and haze are blotches
_MOST_PX = 0.5  # farther off, it was no matter of parts of a pixel
_OUTLIER = 3.0  # standard deviations of the brightness from which pixels count less (Cauchy)
_MEDIAN = 1.4826  # standard deviation over the median of absolute values
_SHAPE = 6.0  # how many times the noise counts once more for sigma: within a window a surface is no plane
_LEAST_SIGMA_PX = 0.04  # chosen with it on five dives: test/benchmark/corrected_sigma.py


def refine_below_a_pixel(
    left: ByteImage, right: ByteImage, disparity: FloatImage, sigma: FloatImage
) -> tuple[FloatImage, FloatImage]:
    """Correct disparities by parts of a pixel where the images say so.

    Parameters
    ----------
    left, right : (H, W) or (H, W, 3) uint8
        Rectified side by side; exactly 0 where nothing is seen.
    disparity, sigma : (H, W) float32
        px; NaN = invalid. A place stays near its disparity as its sigma says.

    Returns
    -------
    disparity, sigma : (H, W) float32
        NaN where `disparity` is. Sigma is smaller where the images say something: what the window's structure tensor
        tells beside what was known, and what one step leaves at best.
    """
    known = np.isfinite(disparity) & np.isfinite(sigma)
    columns = np.arange(disparity.shape[1], dtype=np.float32)[None, :] - np.where(known, disparity, 0).astype(
        np.float32
    )
    rows = np.broadcast_to(np.arange(len(disparity), dtype=np.float32)[:, None], columns.shape)
    one, other = (_gray(image) for image in (left, right))
    there = cv2.remap(other, columns, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    hidden = cv2.remap(unseen(right).astype(np.uint8), columns, rows, cv2.INTER_NEAREST, borderValue=1) > 0
    usable = known & ~unseen(left) & ~hidden & (columns >= 1) & (columns <= disparity.shape[1] - 2)
    if not usable.any():
        return disparity, sigma
    counted = usable.astype(np.float32)
    share = np.maximum(_mean(counted), np.float32(1e-3))
    slope = cv2.Sobel((one + there) / 2, cv2.CV_32F, 1, 0, ksize=3) / 8
    missed = (one - there) * counted
    missed -= _mean(missed) / share * counted  # the views may differ in brightness
    usual = _OUTLIER * _MEDIAN * max(float(np.median(np.abs(missed[usable]))), 1e-3)
    weight = counted / (1 + (missed / usual) ** 2)
    noise = _DOUBT * _mean(weight * missed**2) / (4 * math.pi * _WINDOW_PX**2)
    texture = _mean(weight * slope**2)
    before = np.maximum(np.where(known, sigma, 1), np.float32(1e-3)) ** 2
    step = -_mean(weight * slope * missed) / (texture + noise / before + np.float32(1e-6))
    moved = usable & (np.abs(step) < _MOST_PX)
    after = np.sqrt(1 / (1 / before + texture / (_SHAPE * noise + np.float32(1e-6))) + _LEAST_SIGMA_PX**2)
    return (
        np.where(moved, disparity + step, disparity).astype(np.float32),
        np.where(moved, np.minimum(after, sigma), sigma).astype(np.float32),
    )


def _gray(image: ByteImage) -> FloatImage:
    gray = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)
    return np.asarray(gray, np.float32)


def _mean(image: FloatImage) -> FloatImage:
    return np.asarray(cv2.GaussianBlur(image, (0, 0), _WINDOW_PX), np.float32)
