"""Steps 3, 8 and 9: luminance and chrominance (ITU-R BT.601, full range), and equal colour means.

Cb and Cr are signed, zero for grey, in the unit of Y.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.preprocess.arrays import FloatArray, checked_float, checked_number
from uw_recon_ros.types import Mask

_KR, _KB = 0.299, 0.114  # BT.601
_DARKEST = 1.0 / 255.0  # luminance under which a ratio of luminances means nothing
_LARGEST_RATIO = 8.0
_BINS, _RANGE = 16384, 4.0  # of a histogram; a channel may exceed 1 before it is clipped
_VALUES: FloatArray = (np.arange(_BINS) + 0.5) * (_RANGE / _BINS)

YCBCR_FROM_RGB: NDArray[np.float64] = np.array(
    [
        [_KR, 1 - _KR - _KB, _KB],
        [-0.5 * _KR / (1 - _KB), -0.5 * (1 - _KR - _KB) / (1 - _KB), 0.5],
        [0.5, -0.5 * (1 - _KR - _KB) / (1 - _KR), -0.5 * _KB / (1 - _KR)],
    ]
)
RGB_FROM_YCBCR: FloatArray = np.linalg.inv(YCBCR_FROM_RGB)


def ycbcr_from_rgb(rgb: FloatArray) -> FloatArray:
    """Luminance and chrominance of an RGB image (paper, step 3).

    Parameters
    ----------
    rgb : (H, W, 3) float32 or float64

    Returns
    -------
    (H, W, 3), same dtype
        Y, Cb, Cr; Y in the range of the input, Cb and Cr in half of it on either side of 0.
    """
    return _transformed(checked_float("rgb", rgb, shape="(H, W, 3)"), YCBCR_FROM_RGB)


def rgb_from_ycbcr(ycbcr: FloatArray) -> FloatArray:
    """RGB of luminance and chrominance, not clipped (paper, step 8): the inverse of `ycbcr_from_rgb`."""
    return _transformed(checked_float("ycbcr", ycbcr, shape="(H, W, 3)"), RGB_FROM_YCBCR)


def _transformed(image: FloatArray, matrix: NDArray[np.float64]) -> FloatArray:
    converted: FloatArray = cv2.transform(image, matrix)
    return converted


def luminance(image: FloatArray) -> FloatArray:
    """Y of an RGB image; a mono image is its own luminance.

    Parameters
    ----------
    image : (H, W) or (H, W, 3) float32 or float64
    """
    image = checked_float("image", image, shape="(H, W) or (H, W, 3)")
    return image if image.ndim == 2 else _transformed(image, YCBCR_FROM_RGB[:1])


def replace_luminance(ycbcr: FloatArray, luminance: FloatArray, *, chroma_follows: bool = True) -> FloatArray:
    """Put a filtered luminance in the place of the old one (paper, step 8).

    Parameters
    ----------
    ycbcr : (H, W, 3) float32 or float64
        Y in [0, 1].
    luminance : (H, W), same dtype
        In [0, 1].
    chroma_follows : bool
        Scale Cb and Cr as Y was scaled, at most eightfold: each pixel keeps its hue and saturation. False, as the paper
        says: keep them, so that darkened pixels become garish and brightened ones gray.

    Returns
    -------
    (H, W, 3), same dtype

    Raises
    ------
    TypeError, ValueError
        As `arrays.checked_float`; two sizes.
    """
    ycbcr = checked_float("ycbcr", ycbcr, shape="(H, W, 3)")
    luminance = checked_float("luminance", luminance)
    if luminance.shape != ycbcr.shape[:2]:
        raise ValueError(f"luminance: expected shape {ycbcr.shape[:2]}, as ycbcr, got {luminance.shape}")
    _, blue, red = cv2.split(ycbcr)
    if chroma_follows:
        ratio = luminance / np.maximum(ycbcr[..., 0], _DARKEST)
        np.minimum(ratio, _LARGEST_RATIO, out=ratio)
        blue, red = blue * ratio, red * ratio
    replaced: FloatArray = cv2.merge([luminance, blue, red])
    return replaced


def equalizing_gains(
    images: Sequence[FloatArray], *, max_gain: float = 8.0, masks: Sequence[Mask] = ()
) -> NDArray[np.float64]:
    """Gains that give all channels one mean over all images, after clipping to [0, 1] (paper, step 9).

    Parameters
    ----------
    images : sequence of (H, W, 3) float32 or float64
        Both cameras, RGB; clipped to [0, inf) first.
    max_gain : float
        A channel that needs more, as red far down, is brightened that much and stays behind.
    masks : sequence of (H, W) bool
        What does not count in each image, where anything else is left.

    Returns
    -------
    (3,) float64
        For R, G and B; their common mean is the mean of the three.

    Raises
    ------
    TypeError, ValueError
        As `arrays.checked_float`; no images; a limit under 1.
    """
    if not images:
        raise ValueError("images: expected at least one, got none")
    checked_number("max_gain", max_gain, 1.0, np.inf)
    checked = [checked_float("images", image, shape="(H, W, 3)") for image in images]
    nothing = all(mask.all() for mask in masks)  # also where there are no masks
    counted = [None] * len(checked) if nothing else [(~mask).astype(np.uint8) for mask in masks]
    shares = [_histogram(checked, channel, counted) for channel in range(3)]
    target = float(np.mean([np.sum(share * np.minimum(_VALUES, 1.0)) for share in shares]))
    return np.array([min(_gain(share, target), max_gain) for share in shares])


def _histogram(
    images: Sequence[FloatArray], channel: int, counted: Sequence[NDArray[np.uint8] | None]
) -> NDArray[np.float64]:
    """Share of the pixels at each of `_VALUES`, all images together."""
    counts = np.zeros(_BINS)
    for image, where in zip(images, counted, strict=True):
        level = np.clip(image[..., channel] * image.dtype.type(_BINS / _RANGE), 0, _BINS - 1).astype(np.uint16)
        counts += cv2.calcHist([level], [0], where, [_BINS], [0, _BINS]).ravel()
    share: NDArray[np.float64] = counts / counts.sum()
    return share


def _gain(share: NDArray[np.float64], target: float) -> float:
    """The gain whose clipped mean is `target`.

    With a gain of 1 / v the values up to v are in the mean with v^-1 times themselves, those above with 1; between two
    such gains the mean is linear.
    """
    means = np.cumsum(share * _VALUES) / _VALUES + 1.0 - np.cumsum(share)
    return float(np.interp(target, means[::-1], 1.0 / _VALUES[::-1]))


def apply_gains(image: FloatArray, gains: NDArray[np.float64]) -> FloatArray:
    """Multiply R, G and B by `gains` and clip to [0, 1] (paper, step 9).

    Parameters
    ----------
    image : (H, W, 3) float32 or float64
    gains : (3,) float64
        As from `equalizing_gains`; one set for both cameras.
    """
    image = checked_float("image", image, shape="(H, W, 3)")
    balanced: FloatArray = np.clip(image * gains.astype(image.dtype), 0, 1)
    return balanced
