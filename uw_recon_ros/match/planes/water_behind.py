"""Open water that takes the disparity of the thing before it.

Beside a wreck or above a reef the start is of one piece: even water costs nothing, and takes the disparity of the edge
it ends at. Its texture is none of its own, and three things together tell that:

- some window that holds the pixel is even (least variance of the derivative over windows of `SMALL` px that hold it):
  a window around a pixel beside an edge sees the edge, one on the pixel's own side does not; even is what has less than
  `EVEN` times the noise, and next to nothing of what the image's most textured parts have (mud is even, but alike);
- the views, laid on each other there, are not alike: what is fine in the one is not found in the other (correlation
  over `WIDE` px, of nothing but even pixels that are more than `RIM` px from any edge, whose glow moves with it);
- it goes on from what is surely water: within `STRIDE` px of some that is about as bright, and so on; and of each patch
  at least `SURE_SHARE` is sure.

An even wall of which not much is sure to be water stays a wall. Chosen on nine simulated views and five without
water, of other seeds, waters and places than those that are reported (``docs/matching_experiments.md``).
"""

from __future__ import annotations

import cv2
import numpy as np

from uw_recon_ros.match.planes.gray import some
from uw_recon_ros.match.planes.texture import noise_of_derivative
from uw_recon_ros.types import ByteImage, FloatImage, Mask

SMALL, FINE = 6, 9  #: sides of windows, px: of the variance, and of what counts as fine
EVEN = 10.0  #: variance of the derivative, times the noise's, at most ...
BESIDE, STRONGEST = 0.007, 0.05  #: ... and this part of what the most textured part of the image has
RIM = 6  #: px
WIDE = 61  #: side of the window that views are compared over, px
ALIKE = 0.4  #: correlation
LEAST_SHARE = 0.05  #: of that window must count
STRIDE, ENOUGH, ROUNDS = 30, 0.1, 10  #: px; share of the window of twice that; how often
AS_BRIGHT = 2.0, 2.0  #: standard deviations of the noise, and gray levels
BRIDGE, SURE_SHARE = 12, 0.2  #: px between parts of a patch; part of it
SCALE, _COARSE = 2, 4  # all but differences of neighbours is looked at in every other, or fourth, pixel


def water_behind(
    brightness: FloatImage, slope: FloatImage, theirs: FloatImage, start: FloatImage, noise: float, sure: Mask
) -> Mask:
    """Water that goes on from what is surely water, (H, W) bool.

    Parameters
    ----------
    brightness, slope : (H, W) float32
        The left view, and its `texture.derivative`.
    theirs : (H, W) float32
        The right view's derivative, laid on the left one by the start.
    start : (H, W) float32
        Disparity, px.
    noise : float
        Variance of the derivative that nothing explains.
    sure : (H, W) bool
        Water.
    """
    height, width = slope.shape
    ours, other, squares = (smaller(x, SCALE) for x in (slope, theirs, slope * slope))
    least = _least_variance(ours, squares)
    even = least < EVEN * noise
    inner = cv2.erode(even.view(np.uint8), square(2 * RIM // SCALE + 1))
    there = np.arange(even.shape[1], dtype=np.float32) - start[::SCALE, ::SCALE] / SCALE
    rows = np.repeat(np.arange(even.shape[0], dtype=np.float32)[:, None], even.shape[1], 1)
    other_inner = cv2.remap(inner, there, rows, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE)
    counted = np.minimum(inner, other_inner).astype(np.float32)
    alike = _correlation(_fine(ours), _fine(other), counted)
    blank = even & (least < BESIDE * float(np.quantile(some(least), 1 - STRONGEST)))
    light = smaller(brightness, _COARSE)
    seeds, may_be = sure[::_COARSE, ::_COARSE], blank[::SCALE, ::SCALE] & (alike < ALIKE)
    water = _spread(light, seeds & even[::SCALE, ::SCALE], may_be, noise)
    water = _with_enough(water | seeds, seeds) & water
    grown = cv2.resize(water.view(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)
    evenly = cv2.resize(even.view(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)
    return np.asarray((grown > 0) & (evenly > 0))


def smaller(values: FloatImage, by: int) -> FloatImage:
    """Means of squares of pixels; the last may be cut."""
    size = -(-values.shape[1] // by), -(-values.shape[0] // by)
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_AREA), np.float32)


def _least_variance(slope: FloatImage, squares: FloatImage) -> FloatImage:
    """Of the windows that hold a pixel, from a derivative and its square."""
    side = SMALL // SCALE
    mean, of_squares = (cv2.blur(x, (side, side)) for x in (slope, squares))
    return np.asarray(cv2.erode(of_squares - mean * mean, square(side)), np.float32)


def square(side: int) -> ByteImage:
    """A window, for morphology."""
    return np.ones((side, side), np.uint8)


def _fine(slope: FloatImage) -> FloatImage:
    return np.asarray(slope - cv2.blur(slope, (FINE // SCALE + 1,) * 2), np.float32)


def _correlation(ours: FloatImage, theirs: FloatImage, counted: FloatImage) -> FloatImage:
    """Around each fourth pixel, of what counts; 1 where that is too little."""

    def mean(values: FloatImage) -> FloatImage:
        return np.asarray(cv2.blur(smaller(values, _COARSE // SCALE), (WIDE // _COARSE,) * 2), np.float32)

    x, y = ours * counted, theirs * counted
    found = mean(x * y) / np.sqrt(np.maximum(mean(x * x) * mean(y * y), np.float32(1e-9)))
    return np.asarray(np.where(mean(counted) > LEAST_SHARE, found, 1), np.float32)


def _spread(light: FloatImage, seeds: Mask, may_be: Mask, noise: float) -> Mask:
    """From pixel to pixel of about one brightness."""
    window = (2 * STRIDE // _COARSE + 1,) * 2
    near = np.float32(AS_BRIGHT[0] * np.sqrt(noise / noise_of_derivative()) + AS_BRIGHT[1])
    water = seeds
    for _ in range(ROUNDS):
        known = water.astype(np.float32)
        share, mean = cv2.blur(known, window), cv2.blur(known * light, window)
        grown = water | (may_be & (np.abs(light * share - mean) < near * share) & (share > ENOUGH))
        if (grown == water).all():
            break
        water = grown
    return water


def _with_enough(water: Mask, sure: Mask) -> Mask:
    """Patches of which a part is sure."""
    count, patches = cv2.connectedComponents(cv2.dilate(water.astype(np.uint8), square(2 * BRIDGE // _COARSE + 1)))
    area, known = (np.bincount(patches[mask], minlength=count) for mask in (water, sure))
    kept = known >= SURE_SHARE * np.maximum(area, 1)
    kept[0] = False
    return np.asarray(kept[patches])
