"""Light in open water that is no surface: waves seen from below, the glow around a lamp.

Both views show it, shifted as a thing of its distance would be, so that a disparity is found. Surfaces have fine
texture wherever they have any; scattered light has none. Light is

- textured, but not finely: of the derivative's covariance between the views, laid on each other by the start, next to
  nothing is of what changes within a few pixels (the views' noises are independent, so none of it is noise);
- a patch of some size, most of whose border is water, and brighter than that.

Chosen on the same kinds of views as `water_behind`, of other seeds and waters than those that are reported
(``docs/matching_experiments.md``).
"""

from __future__ import annotations

import cv2
import numpy as np

from uw_recon_ros.match.planes.water_behind import SCALE, smaller, square
from uw_recon_ros.types import FloatImage, Mask

WINDOW, FINE = 18, 6  #: sides, px: of the covariance, and of what counts as fine
LEAST = 2.0  #: covariance, times the noise; less is no texture
SMOOTH, DOUBT = 0.04, 0.1  #: share of the covariance that may be fine, and so many times the noise
THICK = 6  #: px
LEAST_AREA = 0.003  #: of the image
RIM, AMID = 6, 0.5  #: px around a patch, of which at least this share is water
NEAR, ENOUGH = 62, 0.1  #: side of the window, px, that a patch is compared over, and how much of it must be water
BRIGHTER = 2.0  #: gray levels


def smooth_light(brightness: FloatImage, slope: FloatImage, theirs: FloatImage, noise: float, water: Mask) -> Mask:
    """Waves and glow, (H, W) bool.

    Parameters
    ----------
    brightness, slope : (H, W) float32
        The left view, and its `texture.derivative`.
    theirs : (H, W) float32
        The right view's derivative, laid on the left one by the start.
    noise : float
        Variance of the derivative that nothing explains.
    water : (H, W) bool
        What is water already.
    """
    height, width = slope.shape
    smooth = _smooth(smaller(slope, SCALE), smaller(theirs, SCALE), noise)
    count, patches, stats, _ = cv2.connectedComponentsWithStats(smooth)
    around = cv2.dilate(patches.astype(np.float32), square(2 * RIM // SCALE + 1)).astype(np.intp)
    around[patches > 0] = 0
    empty = water[::SCALE, ::SCALE]
    amid = _means(empty, around, count)
    brighter, near = _over_water(smaller(brightness, SCALE), empty)
    lit = _means(brighter[near], patches[near], count)
    is_light = (stats[:, cv2.CC_STAT_AREA] >= LEAST_AREA * smooth.size) & (amid > AMID) & (lit > BRIGHTER)
    is_light[0] = False
    light = is_light[patches].view(np.uint8)
    return np.asarray(cv2.resize(light, (width, height), interpolation=cv2.INTER_NEAREST) > 0)


def _smooth(ours: FloatImage, theirs: FloatImage, noise: float) -> np.ndarray:
    """Pixels that some smooth window holds, (h, w) uint8."""
    side = WINDOW // SCALE

    def mean(values: FloatImage, width: int = side) -> FloatImage:
        return np.asarray(cv2.blur(values, (width, width)), np.float32)

    covariance = mean(ours * theirs) - mean(ours) * mean(theirs)
    fine = mean((ours - mean(ours, FINE // SCALE)) * (theirs - mean(theirs, FINE // SCALE)))
    smooth = (covariance > LEAST * noise) & (fine < SMOOTH * covariance + DOUBT * noise)
    thick = cv2.morphologyEx(smooth.astype(np.uint8), cv2.MORPH_OPEN, square(THICK // SCALE))
    return np.asarray(cv2.dilate(thick, square(side)))


def _over_water(light: FloatImage, water: Mask) -> tuple[FloatImage, Mask]:
    """Brightness over that of the water around, and where there is enough of it."""
    window = (NEAR // SCALE,) * 2
    known = water.astype(np.float32)
    share, mean = cv2.blur(known, window), cv2.blur(known * light, window)
    return np.asarray(light - mean / np.maximum(share, np.float32(1e-3)), np.float32), np.asarray(share > ENOUGH)


def _means(values: np.ndarray, patches: np.ndarray, count: int) -> np.ndarray:
    """Of each patch; 0 where it has no pixel."""
    flat = patches.ravel()
    total = np.bincount(flat, values.ravel(), minlength=count)
    return np.asarray(total / np.maximum(np.bincount(flat, minlength=count), 1))
