"""How sure a disparity is, from what both views show there once the match is known.

Around a pixel the views are laid on each other. What is left of the difference, over the texture that would betray a
shift, is the shift that least squares could not have told from none (Foerstner, 1984): ``r / (n g)``, with r the
standard deviation of the difference over n x n pixels and g the root mean square of the gradient along the baseline.
Noise, haze, blur, a slant not followed and particles in the water all enlarge r / g, whatever the scene. To this comes
what interpolation between the samples costs, which no difference betrays: it grows with the ratio of the second to the
first derivative (2 tan(w / 2) for a wave of w rad a pixel).

Planes may smooth over what is small, and no difference of the views betrays a shift of less than a texture's width. The
start, which knows no planes, disagrees with them there, all over a small window, by more than its own noise: what that
mean disagreement exceeds `EXPECTED` sigma by, in squares, is an error, too (`with_disagreement`; at tie points of real
pairs 4 to 9 in 100 more errors are within sigma then, on simulated dives 1 to 5: ``test/benchmark/tie_points.py``).

What it does not know: an error of rectification, which shifts what is compared for both views alike, and a wrong match
that looks right.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.match.planes.gray import SMOOTHING, Gray, mix
from uw_recon_ros.match.planes.thread_pool import row_bands, run_parallel
from uw_recon_ros.types import ByteImage, FloatImage, Mask

WINDOW = 9  #: side of the window, px
SMALL_THING = 5  #: side of the window that the start's disagreement is averaged over, px
EXPECTED = 1.5  #: sigma that the start's own noise explains
_COMPARABLE_PX = 1.5  # a start that is further away has another surface
_PARTS = 5
_STEPS = 16  # a gray level


class Trust(NamedTuple):
    """What an effort makes of what the views show; both make 68 % of the errors smaller than sigma.

    Measured by ``test/benchmark/sigma_calibration.py``.

    Parameters
    ----------
    factor : float
        Times ``r / (n g)``: neighbouring differences are not independent, and the matcher is no least-squares fit.
    coarse : float
        Sigma where the second derivative is as large as the first, px.
    least : float
        What is never better known, px: a parabola through whole disparities has its own error.
    """

    factor: float
    coarse: float
    least: float


TRUST = {
    "navigation": Trust(2.3, 0.042, 0.05),
    "balanced": Trust(1.95, 0.03, 0.01),
    "quality": Trust(1.7, 0.03, 0.01),
}
MOST = 4.0  #: no sigma is greater, px


def plain_gray(image: ByteImage, noise: float) -> Gray:
    """Gray of an (H, W, C) image, 1/16 gray level, smoothed as `gray.gray_pair` does for a `noise` of 0 to 1.

    Not made alike to the other view's contrast: what such a gain is off by would look like noise.
    """
    gray = mix(image, noise)
    if noise * SMOOTHING > 0.1:
        gray = np.asarray(cv2.GaussianBlur(gray, (0, 0), noise * SMOOTHING), np.float32)
    return np.asarray(np.round(gray * _STEPS), np.int16)


def sigma_of(
    left: Gray, right: Gray, disparity: FloatImage, status: ByteImage, effort: str, threads: int = 1
) -> FloatImage:
    """Standard deviation of a matched disparity: 68 % of the errors are smaller.

    Parameters
    ----------
    left, right : (H, W) int16
        Of `plain_gray`.
    disparity : (H, W) float32
        Left view, px.
    status : (H, W) uint8
        0 where `disparity` counts.
    effort : {'navigation', 'balanced', 'quality'}
        That found the disparity.
    threads : int
        The result does not depend on it.

    Returns
    -------
    (H, W) float32
        px; meaningless where `status` is not 0.
    """
    height, width = left.shape
    parts = np.empty((_PARTS, height, width), np.float32)
    run_parallel(
        lambda b: _compare_views(left, right, disparity, status, *b, parts), row_bands(height, threads), threads
    )
    mean = np.empty_like(parts)

    def average(part: int) -> None:  # each by itself: many channels in one image take OpenCV twice as long
        cv2.blur(parts[part], (WINDOW, WINDOW), mean[part], borderType=cv2.BORDER_REFLECT)

    run_parallel(average, range(_PARTS), threads)
    sigma = np.empty((height, width), np.float32)
    trust = TRUST[effort]
    run_parallel(lambda b: _combine(mean, *trust, b[0], b[1], sigma), row_bands(height, threads), threads)
    return sigma


def with_disagreement(sigma: FloatImage, disparity: FloatImage, start: FloatImage, agreed: Mask) -> FloatImage:
    """Sigma of planes, enlarged where the start says something else.

    Parameters
    ----------
    sigma, disparity : (H, W) float32
        px; NaN = none.
    start : (H, W) float32
        px; `agreed` (H, W) bool says where both views agree about it.

    Returns
    -------
    (H, W) float32
        px; NaN where `sigma` is.
    """
    apart = start - disparity
    counted = agreed & (np.abs(apart) < _COMPARABLE_PX)
    window = SMALL_THING, SMALL_THING
    total, share = (cv2.blur(x.astype(np.float32), window) for x in (np.where(counted, apart, 0), counted))
    squared = np.square(total / np.maximum(share, np.float32(1e-3)))
    variance = np.square(sigma)
    return np.asarray(np.sqrt(variance + np.maximum(squared - EXPECTED**2 * variance, 0)), np.float32)


@kernel(allocates=False)
def _compare_views(
    left: Gray, right: Gray, disparity: FloatImage, status: ByteImage, first: int, last: int, parts: NDArray[np.float32]
) -> None:
    """Write, for rows `first` to `last`: 1, difference, its square, and the squares of both derivatives of the left."""
    width = left.shape[1]
    most = width - 1
    for v in range(first, last):
        row, other = left[v], right[v]
        for u in range(width):
            if status[v, u] != 0:
                parts[:, v, u] = 0
                continue
            x = min(max(np.float32(u) - disparity[v, u], np.float32(0)), np.float32(most))
            i = min(int(x), max(most - 1, 0))
            t = x - np.float32(i)
            a, b = np.float32(other[max(i - 1, 0)]), np.float32(other[i])
            c, d = np.float32(other[min(i + 1, most)]), np.float32(other[min(i + 2, most)])
            half = np.float32(0.5)
            bent = b + half * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)))
            slope = half * (c - a + t * (d - b - c + a))
            before, here, after = np.float32(row[max(u - 1, 0)]), np.float32(row[u]), np.float32(row[min(u + 1, most)])
            gradient = half * (half * (after - before) + slope)
            bend = after - 2 * here + before
            parts[0, v, u] = 1
            parts[1, v, u] = here - bent
            parts[2, v, u] = (here - bent) ** 2
            parts[3, v, u] = gradient * gradient
            parts[4, v, u] = bend * bend


@kernel(allocates=False)
def _combine(
    mean: NDArray[np.float32], factor: float, coarse: float, least: float, first: int, last: int, sigma: FloatImage
) -> None:
    """Turn the window's means into sigma, rows `first` to `last`."""
    smallest = np.float32(1e-3 * _STEPS * _STEPS)
    for v in range(first, last):
        for u in range(sigma.shape[1]):
            share_valid = max(mean[0, v, u], np.float32(1e-6))
            difference = mean[1, v, u] / share_valid
            spread = max(mean[2, v, u] / share_valid - difference * difference, np.float32(0))
            gradient = mean[3, v, u] / share_valid + smallest
            told = factor / WINDOW * np.sqrt(spread / gradient)
            between = coarse * (mean[4, v, u] / share_valid) / gradient
            sigma[v, u] = min(np.sqrt(told * told + between * between + least * least), MOST)
