"""Spatial coherence (paper section 2.3): an edge-preserving filter of the depth map, made on disparities.

In disparity the matcher's noise is the same near and far, and a plane stays a plane; in depth neither holds. The filter
is an edge-avoiding "a trous" cascade [1]_ with a robust local plane [2]_ in place of the local mean, so that slanted
surfaces keep their slant and their borders keep their place.

References
----------
.. [1] H. Dammertz et al., "Edge-avoiding a-trous wavelet transform for fast global illumination filtering", HPG 2010.
.. [2] A. E. Beaton and J. W. Tukey, "The fitting of power series, meaning polynomials", Technometrics 16, 1974.
"""

from __future__ import annotations

import cv2
import numpy as np

from uw_recon_ros.masks import share_around
from uw_recon_ros.reconstruct.planes import fit_planes, flat_planes
from uw_recon_ros.reconstruct.speckles import find_speckles
from uw_recon_ros.types import FloatImage, Mask

#: Standard deviation of rounding to whole pixels: what is assumed where a matcher states none, px.
ROUNDING_SIGMA = 1 / np.sqrt(12)
_SIGMA_LIMITS = 0.03, 0.75  # px; a doubtful pixel must not open its window to the surface behind
_SURELY_LEFT = 0.2  # of sigma, whatever the filter took away: neighbouring errors are not independent
_MOVE_WINDOW, _BEND_WINDOW = 9, 15  # px: over which moves are squared, and over which they agree
_SHRINK = 0.8  # of the bandwidth a level: what is left of the noise shrinks, what is left of the edges does not


def smooth_disparity(disparity: FloatImage, sigma: FloatImage, *, levels: int, sigmas: float) -> FloatImage:
    """Smooth surfaces, keep discontinuities, leave invalid pixels invalid.

    Parameters
    ----------
    disparity : (H, W) float32
        px; NaN = invalid.
    sigma : (H, W) float32
        Its standard deviation, px; where it is not a positive number, that of rounding is taken.
    levels : int
        Passes with sample distances 1, 2, 4, ... px. 0: unchanged.
    sigmas : float
        Pixels further than this many sigma from a pixel's local plane do not influence it.

    Returns
    -------
    (H, W) float32
        Finite exactly where `disparity` is.

    Raises
    ------
    ValueError
    """
    if disparity.ndim != 2 or sigma.shape != disparity.shape:
        raise ValueError(f"disparity, sigma: expected one (H, W) shape, got {disparity.shape} and {sigma.shape}")
    if levels < 0 or not sigmas > 0:
        raise ValueError(f"levels, sigmas: expected >= 0 and > 0, got {levels} and {sigmas}")
    band = np.float32(sigmas) * plausible_sigma(sigma)
    return _cascade(disparity, band, levels) if levels else disparity.astype(np.float32)


def _cascade(disparity: FloatImage, band: FloatImage, levels: int) -> FloatImage:
    """The first fit shares the finest samples with the second: before it, slopes are not known."""
    planes = fit_planes(flat_planes(disparity), band)
    for level in range(levels):
        planes = fit_planes(planes, band, 2**level)
        band = band * np.float32(_SHRINK)
    return planes.value


def sigma_after_smoothing(sigma: FloatImage, before: FloatImage, after: FloatImage) -> FloatImage:
    """What is left of a standard deviation once a filter has moved the values.

    A filter that averages n independent errors moves each by the part it takes away, ``sigma^2 (1 - 1 / n)`` on the
    mean. Where it bends a surface too, neighbours move together by some b, an error that it adds. So ``mean d^2 = b^2 +
    sigma^2 (1 - 1 / n)`` for the moves d, and ``sigma^2 / n + b^2 = sigma^2 - mean d^2 + 2 b^2`` is left.

    Parameters
    ----------
    sigma, before, after : (H, W) float32
        px; NaN = invalid.

    Returns
    -------
    (H, W) float32
        NaN where `sigma` is; never less than a part of it.
    """
    moves = after - before
    valid = np.isfinite(moves)
    moves[~valid] = 0
    near = _mean_around(np.square(moves), valid, _MOVE_WINDOW)
    bent = np.square(_mean_around(moves, valid, _BEND_WINDOW))
    variance = np.square(sigma)
    most = variance + bent
    near -= bent
    remaining = np.minimum(np.maximum(most - near, np.float32(_SURELY_LEFT**2) * variance), most)
    left: FloatImage = np.sqrt(remaining, out=remaining)
    return left


def _mean_around(values: FloatImage, valid: Mask, side: int) -> FloatImage:
    """Mean of a window's valid pixels; the values elsewhere are 0."""
    mean = np.asarray(cv2.blur(values, (side, side)), np.float32)
    mean /= np.maximum(share_around(valid, side, cv2.BORDER_REFLECT_101), np.float32(1e-6))
    return mean


def plausible_sigma(sigma: FloatImage) -> FloatImage:
    """`sigma` within limits, `ROUNDING_SIGMA` where it is no positive number, px."""
    stated = np.where(sigma > 0, sigma, np.float32(ROUNDING_SIGMA))
    return np.clip(stated, *_SIGMA_LIMITS).astype(np.float32)


def remove_speckles(disparity: FloatImage, *, max_jump_px: float, min_area_px: int) -> tuple[FloatImage, Mask]:
    """Set isolated pieces to NaN; see `find_speckles`. Returns the new map and what was removed."""
    speckles = find_speckles(disparity, max_jump_px, min_area_px)
    return np.where(speckles, np.float32(np.nan), disparity).astype(np.float32), speckles
