"""Step 7: clip outliers and stretch what is left over the whole range, by bounds that both cameras share."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.preprocess.arrays import FloatArray, checked_float, checked_number
from uw_recon_ros.types import Mask

_SAMPLES = 1 << 18  # pixels of an image, for percentiles

_SMALLEST_CONTRAST = 1e-3  # under it, what is stretched would be rounding


def joint_percentiles(
    images: Sequence[FloatArray], percents: Sequence[float], masks: Sequence[Mask] = ()
) -> NDArray[np.float64]:
    """Percentiles of all images together.

    Parameters
    ----------
    images : sequence of arrays
        Large ones are sampled on a regular grid.
    percents : sequence of float
        In [0, 100].
    masks : sequence of (H, W) bool
        What does not count in each image, where anything else is left.

    Returns
    -------
    (len(percents),) float64
    """
    sampled = [_sampled(image) for image in images]
    hidden = [_sampled(mask) for mask in masks] or [np.zeros(image.shape, np.bool_) for image in sampled]
    samples = np.concatenate([image[~mask] for image, mask in zip(sampled, hidden, strict=True)])
    if not samples.size:
        samples = np.concatenate([image.ravel() for image in sampled])
    found: NDArray[np.float64] = np.percentile(samples, percents).astype(np.float64)
    return found


def _sampled(image: NDArray[Any]) -> NDArray[Any]:
    step = max(int(np.ceil(np.sqrt(image.size / _SAMPLES))), 1)
    return image[::step, ::step]


def intensity_bounds(
    images: Sequence[FloatArray], clip_percent: float = 0.5, masks: Sequence[Mask] = ()
) -> tuple[float, float]:
    """Luminances that become black and white: the same for all images (paper, step 7).

    Parameters
    ----------
    images : sequence of (H, W) float32 or float64
        Both cameras.
    clip_percent : float
        Share of the pixels to saturate at either end, percent, in [0, 50).
    masks : sequence of (H, W) bool
        What does not count in each image.

    Returns
    -------
    black, white : float

    Raises
    ------
    TypeError, ValueError
        As `arrays.checked_float`; no images; a share out of range.
    """
    if not images:
        raise ValueError("images: expected at least one, got none")
    checked_number("clip_percent", clip_percent, 0.0, 49.9)
    checked = [checked_float("images", image) for image in images]
    black, white = joint_percentiles(checked, (clip_percent, 100.0 - clip_percent), masks)
    return float(black), float(white)


def stretch(image: FloatArray, bounds: tuple[float, float]) -> FloatArray:
    """Map `bounds` to 0 and 1 and clip what lies outside (paper, step 7).

    Parameters
    ----------
    image : (H, W) float32 or float64
    bounds : (black, white)
        As from `intensity_bounds`. Closer than 1e-3, as of a blank image: it becomes gray.

    Returns
    -------
    (H, W), same dtype
        In [0, 1].
    """
    array = checked_float("image", image)
    black, white = bounds
    if white - black < _SMALLEST_CONTRAST:
        return np.full_like(array, 0.5)
    kind: Any = array.dtype.type
    stretched: FloatArray = np.clip((array - kind(black)) * kind(1.0 / (white - black)), 0, 1)
    return stretched
