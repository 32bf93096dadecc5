"""What the water did to the colours, undone for the whole picture: one affine map of linear light for both cameras.

Per channel the light that arrives is ``a_c J + v_c``: what is left of the scene's, and the water's veil. A part of what
is darkest counts as veil; the channels' bright parts are made equal (shades of gray [1]_). A channel that would need
more than `MOST_GAIN` tells little of the scene: what is missing of it is lent by the others, so that no dead channel
leaves a cast and none is turned against them.

References
----------
.. [1] G. Finlayson and E. Trezzi, "Shades of gray and colour constancy", Color Imaging Conference (2004) 37-41.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.preprocess.arrays import FloatArray
from uw_recon_ros.types import Mask

MOST_GAIN = 30.0  #: of a channel's linear light
_NORM = 3.0  # 1 is the gray world, infinity the white patch
_VEIL = 0.4  # share of what is darkest that is taken away
_DARKEST_PERCENT = 1.0
_SAMPLE = (64, 48)  # px: so small that the noise is gone
_DARK = 1e-5  # linear light


def white_balance(images: Sequence[FloatArray], masks: Sequence[Mask] = ()) -> NDArray[np.float64]:
    """The map of linear RGB that balances all images together.

    Parameters
    ----------
    images : sequence of (H, W, 3) float32
        Both cameras, RGB in [0, 1], as a camera gives them (gamma about 2).
    masks : sequence of (H, W) bool
        What does not count in each image, where anything else is left.

    Returns
    -------
    (3, 4) float64
        For `cv2.transform` on the squares of the values; rows are R, G, B.
    """
    light = _samples(images, masks)
    veil = _VEIL * np.percentile(light, _DARKEST_PERCENT, axis=0)
    direct = np.maximum(light - veil, 0.0)
    bright = np.power(np.mean(np.power(direct, _NORM), axis=0), 1.0 / _NORM)
    needed = (bright.max() + _DARK) / (bright + _DARK)
    mixed = _lend(needed)
    return np.column_stack([mixed, -mixed @ veil])


def _samples(images: Sequence[FloatArray], masks: Sequence[Mask]) -> NDArray[np.float64]:
    """Linear light of what all images show, far reduced: (N, 3)."""
    masks = masks if masks and not all(mask.all() for mask in masks) else [np.zeros(i.shape[:2], bool) for i in images]
    kept = []
    for image, mask in zip(images, masks, strict=True):
        hidden = cv2.resize(mask.astype(np.float32), _SAMPLE, interpolation=cv2.INTER_AREA)
        reduced = cv2.resize(image, _SAMPLE, interpolation=cv2.INTER_AREA)
        kept.append(np.square(reduced[hidden < 0.5], dtype=np.float64))
    return np.concatenate(kept)


def _lend(needed: NDArray[np.float64]) -> NDArray[np.float64]:
    """(3, 3): each channel's gain, and what the strong ones lend to one whose gain is not allowed."""
    own = np.minimum(MOST_GAIN / needed, 1.0)
    strong = own >= 1.0  # at least the brightest channel is
    lent = np.outer(1.0 - own, np.where(strong, needed, 0.0) / np.count_nonzero(strong))
    return np.asarray(np.diag(own * np.minimum(needed, MOST_GAIN)) + lent)
