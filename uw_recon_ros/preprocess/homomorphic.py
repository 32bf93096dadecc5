"""Step 4: illumination is slow and multiplies, so it is weak where the logarithm's low frequencies are (eq. 1-5)."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.fft
from numpy.typing import NDArray

from uw_recon_ros.preprocess.arrays import FloatArray, checked_float, checked_number

LOG_FLOOR = 1.0 / 255.0  #: one grey level of an 8-bit image: keeps the logarithm of black finite


def homomorphic_gain(
    shape: tuple[int, int], cutoff: float, low_gain: float = 0.5, high_gain: float = 2.5
) -> NDArray[np.float64]:
    """``H = (r_H - r_L) (1 - exp(-w^2 / (2 cutoff^2))) + r_L`` on the half spectrum of a real image (paper, eq. 5).

    Parameters
    ----------
    shape : (H, W)
        Size of the image, px.
    cutoff : float
        The paper's delta_w, cycles per longer side of the image.
    low_gain, high_gain : float
        The paper's r_L at frequency 0 and r_H at high frequencies.

    Returns
    -------
    (H, W // 2 + 1) float64
        In the order of ``scipy.fft.rfft2``.

    Raises
    ------
    ValueError
        A cutoff that is not positive, or a negative gain.
    """
    checked_number("cutoff", cutoff, np.finfo(float).tiny, np.inf)
    checked_number("low_gain", low_gain, 0.0, np.inf)
    checked_number("high_gain", high_gain, 0.0, np.inf)
    height, width = shape
    scale = max(height, width) / cutoff
    falls = np.exp(-0.5 * np.square(scipy.fft.fftfreq(height) * scale))
    falls_u = np.exp(-0.5 * np.square(scipy.fft.rfftfreq(width) * scale))
    gain: NDArray[np.float64] = high_gain - (high_gain - low_gain) * np.outer(falls, falls_u)
    return gain


def homomorphic_filter(
    luminance: FloatArray, cutoff: float, low_gain: float = 0.5, high_gain: float = 2.5
) -> FloatArray:
    """Even out slow illumination and lift detail (paper, step 4, eq. 2-5).

    Parameters
    ----------
    luminance : (H, W) float32 or float64
        Luminance in [0, 1]; below zero counts as zero. The spectrum wraps around, so extend the image first.
    cutoff, low_gain, high_gain : float
        As in `homomorphic_gain`.

    Returns
    -------
    (H, W), same dtype
        ``exp(filtered ln(luminance + LOG_FLOOR))``: positive, of no fixed range.

    Raises
    ------
    TypeError, ValueError
        As `arrays.checked_float` and `homomorphic_gain`.
    """
    image = checked_float("luminance", luminance)
    gain = homomorphic_gain(image.shape, cutoff, low_gain, high_gain).astype(image.dtype)
    return np.exp(_filtered(np.log(np.maximum(image, 0) + image.dtype.type(LOG_FLOOR)), gain))


def _filtered(image: FloatArray, gain: NDArray[Any]) -> FloatArray:
    spectrum = scipy.fft.rfft2(image)  # eq. 3
    spectrum *= gain  # eq. 4
    filtered: FloatArray = scipy.fft.irfft2(spectrum, s=image.shape, overwrite_x=True)
    return filtered
