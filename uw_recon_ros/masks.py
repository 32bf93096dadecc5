"""Masks over images, by OpenCV: sums of floats and ``numpy.where`` take several times as long."""

from __future__ import annotations

import cv2
import numpy as np

from uw_recon_ros.types import FloatImage, Mask


def share_around(mask: Mask, side: int, border: int = cv2.BORDER_REPLICATE) -> FloatImage:
    """Share of a square window, side in px, that is in a mask, (H, W) float32; `border` as OpenCV names it."""
    share = cv2.boxFilter(mask.view(np.uint8), cv2.CV_32F, (side, side), borderType=border)
    return np.asarray(share, np.float32)


def only_where(mask: Mask, values: FloatImage, elsewhere: float = np.nan) -> FloatImage:
    """The values, (H, W) float32, in a mask, and another one elsewhere."""
    kept = np.full(values.shape, elsewhere, np.float32)
    return np.asarray(cv2.copyTo(np.asarray(values, np.float32), np.ascontiguousarray(mask).view(np.uint8), kept))
