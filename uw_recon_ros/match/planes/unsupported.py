"""Pieces of a disparity map that nothing carries: what chance, drifting particles or a veil make of empty water.

A wrong piece looks like a surface pixel by pixel. As a whole it does not: hardly one of its pixels is likely right
(`confidence`); or it is of faint texture and lies at the upper end of the searched disparities, where a veil's slow
changes match best; or it is small, faint, and amid water or at the lower end, where all gathers that would lie further
away. The more of its surroundings are water or doubtful pieces, the surer a small piece must be.

Chosen on simulated open water and on Middlebury pairs in four waters, where what is left out was wrong more often than
right in every water (``test/benchmark/open_water.py``, ``docs/matching_experiments.md``).
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.connected_pieces import label_pieces
from uw_recon_ros.match.planes.open_water import OpenWater
from uw_recon_ros.types import FloatImage, Mask

JUMP_PX = 1.0  #: a larger step ends a piece
LEAST_CONFIDENCE = 0.6  #: mean of a piece
ALONE = 0.25  #: to be added for a small piece amid nothing but water
SMALL = 0.02  #: of the image
AROUND = 31  #: side of what counts as surroundings, px
ISLAND = 0.9  #: share of water around that makes a small faint piece water, too
MOSTLY = 0.5  #: share of a piece that is faint, or at an end
END_PX, END = 1.0, 0.05  #: from the least or greatest disparity searched, and at most this part of them


def unfounded(disparity: FloatImage, confidence: FloatImage, water: OpenWater, limits: tuple[float, float]) -> Mask:
    """Pixels with a disparity, (H, W) bool, that belong to such pieces.

    Parameters
    ----------
    disparity, confidence : (H, W) float32
        px, and 0 to 1; NaN = none.
    water : OpenWater
        Of `open_water`.
    limits : (float, float)
        Least and greatest disparity searched, px.
    """
    known = np.isfinite(disparity)
    labels = label_pieces(disparity, JUMP_PX)
    area: NDArray[np.float64] = np.bincount(labels.ravel(), known.ravel().astype(np.float64)).astype(np.float64)
    trust = _mean(confidence, known, labels, area)
    faint = _mean(water.faint, known, labels, area) > MOSTLY
    end = min(END_PX, END * (limits[1] - limits[0]))
    far, near = (
        _mean(there, known, labels, area) > MOSTLY
        for there in (disparity < limits[0] + end, disparity > limits[1] - end)
    )
    doubtful = known & ((trust < LEAST_CONFIDENCE) | (near & faint))[labels]
    small = known & ~doubtful & (area[labels] < SMALL * disparity.size)
    if not small.any():
        return np.asarray(doubtful)
    empty = _mean(_share_of_rest(water.shown | doubtful, small), small, labels, area)
    lost = (((empty > ISLAND) | far) & faint) | (trust < LEAST_CONFIDENCE + ALONE * empty)
    return np.asarray(doubtful | (small & lost[labels]))


def _mean(
    values: FloatImage | Mask, where: Mask, labels: NDArray[np.int32], area: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Of each piece."""
    sums = np.bincount(labels[where], values[where].astype(np.float64), minlength=area.size)
    return np.asarray(sums / np.maximum(area, 1))


def _share_of_rest(empty: Mask, small: Mask) -> FloatImage:
    """Share of `empty` around each pixel, in what is no small piece itself."""
    around = (AROUND, AROUND)
    shares = (cv2.blur(m.astype(np.float32), around, borderType=cv2.BORDER_REPLICATE) for m in (empty, ~small))
    part, rest = shares
    return np.asarray(part / np.maximum(rest, np.float32(1e-3)), np.float32)
