"""Smoothing that keeps edges, by the picture itself as its guide.

References
----------
.. [1] K. He and J. Sun, "Fast guided filter", arXiv:1505.00996 (2015).
"""

from __future__ import annotations

import cv2
import numpy as np

from uw_recon_ros.preprocess.arrays import FloatArray, checked_float, checked_number


def guided_smooth(plane: FloatArray, *, radius: int, edge: float, reduction: int = 1) -> FloatArray:
    """Smooth areas whose standard deviation is well under `edge`, and leave what varies more.

    Parameters
    ----------
    plane : (H, W) float32 or float64
    radius : int
        Of the window, px of `plane`.
    edge : float
        Standard deviation of which half is kept, unit of `plane`.
    reduction : int
        Windows are looked at in the plane so many times smaller [1]_; the result has every pixel.

    Returns
    -------
    (H, W), same dtype

    Raises
    ------
    TypeError, ValueError
        As `arrays.checked_float`; a radius or a reduction under 1, a negative edge.
    """
    plane = checked_float("plane", plane)
    checked_number("radius", radius, 1, np.inf)
    checked_number("edge", edge, 0.0, np.inf)
    checked_number("reduction", reduction, 1, np.inf)
    slope, offset = _lines(reduced(plane, reduction), max(round(radius / reduction), 1), edge)
    if reduction > 1:
        size = plane.shape[::-1]
        slope, offset = (cv2.resize(line, size, interpolation=cv2.INTER_LINEAR) for line in (slope, offset))
    smooth: FloatArray = cv2.multiply(slope, plane)
    return cv2.add(smooth, offset, dst=smooth)


def reduced(image: FloatArray, times: int) -> FloatArray:
    """An image (H, W) or (H, W, C) so many times smaller each way, by the mean of each area; at least 1 px."""
    if times == 1:
        return image
    height, width = image.shape[:2]
    smaller: FloatArray = cv2.resize(
        image, (max(width // times, 1), max(height // times, 1)), interpolation=cv2.INTER_AREA
    )
    return smaller


def _lines(plane: FloatArray, radius: int, edge: float) -> tuple[FloatArray, FloatArray]:
    """Slope and offset of the line that each window is smoothed by, averaged over the windows of a pixel."""
    mean = _boxed(plane, radius)
    variance = np.maximum(_boxed(plane * plane, radius) - mean * mean, 0)
    tiny = np.finfo(plane.dtype).tiny
    slope = variance / (variance + plane.dtype.type(max(edge * edge, tiny)))
    return _boxed(slope, radius), _boxed(mean - slope * mean, radius)


def _boxed(plane: FloatArray, radius: int) -> FloatArray:
    side = 2 * radius + 1
    boxed: FloatArray = cv2.blur(plane, (side, side), borderType=cv2.BORDER_REFLECT)
    return boxed
