"""Open water: faint texture about which the start cannot settle on a surface.

What enhancing leaves of the noise is no longer white, so that its second differences underestimate it many times over,
and the veil of open water seems textured. Two things together tell it from a surface, both from the pair itself:

- it is *faint*: the derivative along the row varies by less than `FAINT` times what the views, laid on each other by
  the start, leave unexplained where either shows least;
- the start is *of many pieces* there: less than `OF_ONE_PIECE` of the surroundings lie on one surface that both views
  agree about. A blank wall is faint too, but of one piece. The smoother the noise, the larger the pieces that chance
  makes.

Where much of the surroundings is such water, being of many pieces is enough: particles drift in it. What goes on from
it beside and behind things is of one piece, theirs: `water_behind` tells it. Waves above and the glow of lamps have
their own distance: `smooth_light` tells them.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from uw_recon_ros.masks import share_around
from uw_recon_ros.match.planes.gray import some
from uw_recon_ros.match.planes.smooth_light import smooth_light
from uw_recon_ros.match.planes.texture import WINDOW, Texture, derivative, grown_from, local_variance
from uw_recon_ros.match.planes.water_behind import water_behind
from uw_recon_ros.medians import median
from uw_recon_ros.types import FloatImage, Mask

FAINT = 10.0, 20.0  #: times the unexplained, and somewhere in a patch; more is texture
MOST = 20.0  #: times the white noise; where more is unexplained, the start is wrong, as on a steep slope
LEAST = 0.2  #: the unexplained is taken from this part of the image
OF_ONE_PIECE = 0.6, 0.85  #: share of the surroundings: where the noise is white, and where it is smooth ...
SMOOTH = 2.0, 5.0  #: ... by how many times more is unexplained than white noise would leave
AROUND = 37  #: side of these, px
THINNED = 2  #: they are looked at in every n-th pixel
NEAR_PX = 1.0  #: from the median around
MURKY, REACH, ROUNDS = 0.4, 41, 3  #: share of water within this window that makes what is of many pieces water, too


class OpenWater(NamedTuple):
    """What `open_water` tells, (H, W) bool each.

    Parameters
    ----------
    shown
        Pixels of the left view that show water rather than a surface.
    faint
        Where texture is too faint to tell a surface by itself.
    """

    shown: Mask
    faint: Mask


def open_water(texture: Texture, start: FloatImage, agreed: Mask) -> OpenWater:
    """Tell water from surfaces; of images too small to judge nothing is said.

    Parameters
    ----------
    texture : Texture
        Of both views.
    start : (H, W) float32
        The start's disparity, px.
    agreed : (H, W) bool
        Where both views agree about it.
    """
    if texture.smaller_side < AROUND:
        return OpenWater(*np.zeros((2, *start.shape), np.bool_))
    theirs = _laid_on(derivative(texture.views[1]), start)
    noise = _noise(texture, theirs)
    enough = np.interp(noise / texture.floor, SMOOTH, OF_ONE_PIECE)
    scattered = _share_of_one_piece(start, agreed) < enough
    faint = ~grown_from(texture.variance / np.float32(noise), *FAINT)
    water = scattered & faint
    for _ in range(ROUNDS if water.any() else 0):
        water |= scattered & (share_around(water, REACH) > MURKY)
    if water.any():
        behind = water_behind(texture.views[0], texture.slope, theirs, start, noise, water)
        water |= behind
        light = smooth_light(texture.views[0], texture.slope, theirs, noise, water)
        water |= light
        faint |= behind | light
    return OpenWater(water, faint)


def _share_of_one_piece(start: FloatImage, agreed: Mask) -> FloatImage:
    """Of every other pixel of every other row: the windows are large."""
    height, width = start.shape
    start, agreed = start[::THINNED, ::THINNED], agreed[::THINNED, ::THINNED]
    lowest = float(start.min())
    step = max(float(start.max()) - lowest, 1.0) / 255
    median = cv2.medianBlur(np.round((start - lowest) / step).astype(np.uint8), WINDOW // THINNED)
    near = agreed & (np.abs(start - lowest - median * np.float32(step)) < NEAR_PX + step / 2)
    side = AROUND // THINNED + 1
    return np.asarray(cv2.resize(share_around(near, side, cv2.BORDER_REFLECT_101), (width, height)), np.float32)


def _laid_on(right: FloatImage, start: FloatImage) -> FloatImage:
    """A right view as the left one would see it."""
    height, width = start.shape
    u, v = np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32)
    there = u - start, np.repeat(v[:, None], width, 1)
    return np.asarray(cv2.remap(right, *there, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE), np.float32)


def _noise(texture: Texture, theirs: FloatImage) -> float:
    """What of the derivative's variance is unexplained by the other view, where the variance is least."""
    unexplained = some(local_variance(np.asarray(texture.slope - theirs, np.float32))) / 2
    variance = some(texture.variance)
    least = variance <= np.quantile(variance, LEAST)
    return min(max(median(unexplained[least]), texture.floor), MOST * texture.floor)
