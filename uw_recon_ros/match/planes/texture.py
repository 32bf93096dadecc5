"""Where there is nothing to match: texture that does not rise above the pair's own noise.

A surface's disparity can be told from the brightness changing along the row. Noise changes it too, by a known amount
(Gaussian derivative of white noise), so there is texture where the variance of the smoothed image's derivative over
a window is more than `RISE` times what the noise alone would give, in a patch that somewhere reaches `SURE` times
(two thresholds, as for the edges of Canny, 1986: chance alone passes the first in 3 of 100 windows). A pixel is
untextured where neither it nor any other within `CARRY` px has texture: over a shorter gap its surroundings carry the
surface.

The numbers were chosen on the Middlebury pairs in air and in two waters: under noise that hides a third of an image's
texture, what remains has a third to a half fewer errors, and even with the holes filled there are not more; in air,
1.4 % of a pair is left out at most (``test/benchmark/low_texture.py``).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.match.planes.gray import mix
from uw_recon_ros.types import ByteImage, FloatImage, Mask

SMOOTHING = 1.0  #: of the derivative, px
WINDOW = 15  #: side of the window that its variance is taken over, px
RISE, SURE = 1.6, 2.5  #: what that must be of what noise alone gives, and somewhere in a patch
CARRY = 4  #: px
_BORDER = 2  # px
QUIETEST = 0.05  #: the noise is that of the quietest part of the windows ...
_OF_ALL = 0.9  # ... where it is this part of the typical one, if there is nothing but noise
ROUNDING = 0.29  #: least noise, gray levels: that of whole numbers
#: Second differences that no plane or edge along an axis has (Immerkaer, 1996); they make 36 times the variance.
_LAPLACIANS = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float32)


@dataclass(frozen=True, eq=False)
class Texture:
    """What is measured of both views' texture, each once and only when it is asked for.

    Parameters
    ----------
    left, right : (H, W, C) uint8
        C = 1 or 3.
    """

    left: ByteImage
    right: ByteImage

    @property
    def smaller_side(self) -> int:
        """Of the images, px."""
        return int(min(self.left.shape[:2]))

    @cached_property
    def views(self) -> tuple[FloatImage, FloatImage]:
        """Brightness of either view, (H, W)."""
        return mix(self.left, 0), mix(self.right, 0)

    @cached_property
    def slope(self) -> FloatImage:
        """The left view's `derivative`."""
        return derivative(self.views[0])

    @cached_property
    def variance(self) -> FloatImage:
        """Of `slope`, around each pixel."""
        return local_variance(self.slope)

    @cached_property
    def floor(self) -> float:
        """Variance of `derivative` that the white noise of the noisier view makes."""
        return max(noise_sigma(view) for view in self.views) ** 2 * noise_of_derivative()


def untextured_mask(texture: Texture) -> Mask:
    """Pixels of the left view, (H, W) bool, whose disparity nothing in the image tells.

    The noisier of the two views decides what counts as texture. Of images smaller than a window nothing is said.
    """
    if texture.smaller_side < WINDOW:
        return np.zeros(texture.left.shape[:2], np.bool_)
    return ~grown_from(texture.variance / np.float32(texture.floor), RISE, SURE)


def grown_from(rise: FloatImage, low: float, high: float) -> Mask:
    """Patches over `low` that somewhere reach `high`, and what lies within `CARRY` of them."""
    count, patches = cv2.connectedComponents((rise > low).astype(np.uint8))
    textured = np.empty(rise.shape, np.uint8)
    _reaching(rise, np.float32(high), np.asarray(patches, np.int32), np.zeros(count, np.uint8), textured)
    side = 2 * CARRY + 1
    carried = cv2.dilate(textured, np.ones((side, side), np.uint8), borderType=cv2.BORDER_REPLICATE)
    return np.asarray(carried, np.uint8).view(np.bool_)


@kernel(allocates=False)
def _reaching(
    rise: FloatImage, high: np.float32, patches: NDArray[np.int32], reach: ByteImage, textured: ByteImage
) -> None:
    """Write 1 where a patch is that somewhere rises over `high`, else 0; `reach`, of each patch, begins with 0."""
    height, width = rise.shape
    for v in range(height):
        for u in range(width):
            if rise[v, u] > high:
                reach[patches[v, u]] = 1
    for v in range(height):
        for u in range(width):
            textured[v, u] = reach[patches[v, u]]


def noise_sigma(gray: FloatImage) -> float:
    """Standard deviation of the noise, gray levels, where the image is quietest; windows of one value do not count."""
    squares = cv2.filter2D(gray, -1, _LAPLACIANS)[1:-1, 1:-1] ** 2 / 36
    side, half = WINDOW - 2, (WINDOW - 2) // 2
    means = cv2.blur(squares, (side, side))[half:-half:half, half:-half:half]
    means = means[means > 1e-6]
    quiet = float(np.sqrt(np.quantile(means, QUIETEST))) / _OF_ALL if means.size else 0.0
    return max(quiet, ROUNDING)


def derivative(gray: FloatImage) -> FloatImage:
    """Derivative along the row of the smoothed image; 0 at the outermost pixels.

    Those are smoothed with fewer neighbours and so keep more noise: `local_variance` does not count them.
    """
    smooth = cv2.GaussianBlur(gray, (0, 0), SMOOTHING)
    slope = np.zeros_like(smooth)
    inner = (slice(_BORDER, -_BORDER),) * 2
    slope[inner] = ((smooth[:, 2:] - smooth[:, :-2]) / 2)[_BORDER:-_BORDER, _BORDER - 1 : 1 - _BORDER]
    return np.asarray(slope, np.float32)


def local_variance(slope: FloatImage) -> FloatImage:
    """Variance of a derivative over a window; a veil that brightens evenly has none."""
    inner = (slice(_BORDER, -_BORDER),) * 2
    counted = np.zeros_like(slope)
    counted[inner] = slope[inner]
    share = _inverse_counts(slope.shape)
    mean = _window_sums(counted)
    counted *= counted
    variance = _window_sums(counted)
    for sums in (mean, variance):
        sums *= share
    mean *= mean
    variance -= mean
    return np.maximum(variance, 0, out=variance)


@lru_cache(maxsize=4)
def _inverse_counts(shape: tuple[int, int]) -> FloatImage:
    """One over the pixels that count in each window."""
    counted = np.zeros(shape, np.float32)
    counted[(slice(_BORDER, -_BORDER),) * 2] = 1
    return np.asarray(1 / _window_sums(counted), np.float32)


def _window_sums(image: FloatImage) -> FloatImage:
    sums = cv2.boxFilter(image, -1, (WINDOW, WINDOW), normalize=False, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(sums, np.float32)


def noise_of_derivative() -> float:
    """Mean square of the derivative of noise of unit variance: that of the filter's weights."""
    weights = _gaussian()
    along = np.convolve(weights, [0.5, 0, -0.5])
    return float((weights**2).sum() * (along**2).sum())


def _gaussian() -> NDArray[np.float64]:
    impulse = np.zeros((1, 31), np.float32)
    impulse[0, 15] = 1
    return np.asarray(cv2.GaussianBlur(impulse, (0, 0), SMOOTHING, borderType=cv2.BORDER_REPLICATE)[0], np.float64)
