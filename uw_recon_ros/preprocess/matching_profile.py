"""What the matcher sees under the profile `matching`: less noise, contrast and edges as they were.

The water takes one colour more than the others, noise remains in all: so the channels are weighed by what they tell.
Then the wavelets of step 5, whose traces depend on where a pixel lies, are averaged over two positions, since the same
point lies elsewhere in the other camera. Raising the contrast, as steps 4 and 7 do, raised the disparity error in every
kind of water, for a semi-global matcher (``test/benchmark/preprocess_profiles.py``).
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.preprocess import wavelet
from uw_recon_ros.preprocess.arrays import FloatArray, checked_float, checked_number
from uw_recon_ros.preprocess.color import YCBCR_FROM_RGB
from uw_recon_ros.preprocess.filterbank import diagonal_detail

_GRAY_LEVEL = 1.0 / 255.0
_TEXTURE_LAG = 4  # px: differences at this distance are texture and noise
_SAMPLES = 1 << 17  # pixels of an image that are looked at for the channels' texture and noise
_BORDER = 8  # px mirrored around an image that is denoised


def channel_weights(images: Sequence[FloatArray]) -> NDArray[np.float64]:
    """Weights of R, G and B for the gray image of the best ratio of texture to noise.

    For channels ``a_c t + n_c`` of one texture t and independent noise, the best weights are ``a_c / var(n_c)``.

    Parameters
    ----------
    images : sequence of (H, W, 3) float32 or float64
        Both cameras, RGB in [0, 1].

    Returns
    -------
    (3,) float64
        Of sum 1; those of luminance where there is no texture.

    Raises
    ------
    TypeError, ValueError
        As `arrays.checked_float`; no images.
    """
    if not images:
        raise ValueError("images: expected at least one, got none")
    checked = [checked_float("images", image, shape="(H, W, 3)") for image in images]
    weights = np.array([_texture_over_variance(planes) for planes in zip(*map(cv2.split, checked), strict=True)])
    if not weights.any():
        weights = YCBCR_FROM_RGB[0].copy()
    weights /= weights.sum()
    return weights


def _texture_over_variance(planes: Sequence[FloatArray]) -> float:
    noise = max(_noise_sigma([_middle_rows(plane) for plane in planes]), _GRAY_LEVEL)
    step = max(1, planes[0].size // _SAMPLES)
    ways = [
        (now, then)
        for plane in planes
        for now, then in (
            (plane[::step, _TEXTURE_LAG:], plane[::step, :-_TEXTURE_LAG]),
            (plane[_TEXTURE_LAG:, ::step], plane[:-_TEXTURE_LAG, ::step]),
        )
        if now.size
    ]
    squares = sum(cv2.norm(np.ascontiguousarray(now), np.ascontiguousarray(then), cv2.NORM_L2SQR) for now, then in ways)
    mean = (2 * noise**2 + squares) / (1 + sum(now.size for now, _ in ways))
    return float(np.sqrt(max(0.5 * mean - noise**2, 0.0))) / noise**2


def _middle_rows(plane: FloatArray) -> FloatArray:
    """So many rows around the middle that they hold `_SAMPLES` pixels."""
    rows = min(plane.shape[0], max(1, _SAMPLES // plane.shape[1]))
    first = (plane.shape[0] - rows) // 2
    return plane[first : first + rows]


def _noise_sigma(planes: Sequence[FloatArray]) -> float:
    return wavelet.sigma_of_details([diagonal_detail(_bordered(plane, 1)) for plane in planes])


def weighted_gray(image: FloatArray, weights: NDArray[np.float64]) -> FloatArray:
    """Gray image of an RGB one by given weights.

    Parameters
    ----------
    image : (H, W, 3) float32 or float64
    weights : (3,) float64
        As from `channel_weights`; one set for both cameras.

    Returns
    -------
    (H, W), same dtype
    """
    gray: FloatArray = cv2.transform(checked_float("image", image, shape="(H, W, 3)"), weights[None])
    return gray


def excess_sigma(images: Sequence[FloatArray]) -> float:
    """Noise of all images together beyond one gray level of 8 bits, in the images' unit.

    Parameters
    ----------
    images : sequence of (H, W) float32 or float64
        Both cameras, in [0, 1].
    """
    noise = _noise_sigma([checked_float("images", image) for image in images])
    return float(np.sqrt(max(noise**2 - _GRAY_LEVEL**2, 0.0)))


def denoise_evenly(gray: FloatArray, sigma: float, *, levels: int = 4) -> FloatArray:
    """Remove white noise, the mean of two decompositions one pixel apart.

    Parameters
    ----------
    gray : (H, W) float32 or float64
    sigma : float
        Standard deviation of the noise, image's unit; 0 returns `gray`.
    levels : int
        Levels to shrink.

    Returns
    -------
    (H, W), same dtype
    """
    gray = checked_float("gray", gray)
    checked_number("sigma", sigma, 0.0, np.inf)
    if sigma == 0:
        return gray
    here = wavelet.wavelet_denoise(_bordered(gray, levels + 1), levels, sigma)
    beside = wavelet.wavelet_denoise(_bordered(gray, levels + 1, moved=1), levels, sigma)
    height, width = gray.shape
    mean: FloatArray = cv2.addWeighted(
        here[_BORDER : _BORDER + height, _BORDER : _BORDER + width], 0.5,
        beside[_BORDER + 1 : _BORDER + 1 + height, _BORDER + 1 : _BORDER + 1 + width], 0.5, 0.0,
    )  # fmt: skip
    return mean


def _bordered(image: FloatArray, levels: int, moved: int = 0) -> FloatArray:
    """Mirrored by at least `_BORDER` px a side, less `moved`, to sizes that can be halved `levels` times."""
    multiple, before = 1 << levels, _BORDER + moved
    after = [_BORDER + -(size + 2 * _BORDER) % multiple - moved for size in image.shape]
    bordered: FloatArray = cv2.copyMakeBorder(image, before, after[0], before, after[1], cv2.BORDER_REFLECT)
    return bordered
