"""Pieces of a disparity map that nothing carries: what chance, drifting particles or a veil make of empty water.

A wrong piece looks like a surface pixel by pixel. As a whole it does not: hardly one of its pixels is likely right
(`confidence`); or it is of faint texture and lies at the upper end of the searched disparities, where a veil's slow
changes match best; or it is small, faint, and amid water or at the lower end, where all gathers that would lie further
away. The more of its surroundings are water or doubtful pieces, the surer a small piece must be.

Chosen on simulated open water and on Middlebury pairs in four waters, where what is left out was wrong more often than
right in every water (``test/benchmark/open_water.py``, ``docs/matching_experiments.md``).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.connected_pieces import label_pieces
from uw_recon_ros.jit import kernel
from uw_recon_ros.masks import share_around
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
    labels = label_pieces(disparity, JUMP_PX)
    end = min(END_PX, END * (limits[1] - limits[0]))
    pieces = np.zeros((int(labels.max()) + 1, len(_Piece._fields)))
    _add_up(disparity, confidence, water.faint, labels, limits[0] + end, limits[1] - end, pieces)
    of = _Piece(*pieces.T)
    trust, faint, near, far = (x / np.maximum(of.area, 1) for x in (of.trust, of.faint, of.near, of.far))
    is_doubtful = (trust < LEAST_CONFIDENCE) | ((near > MOSTLY) & (faint > MOSTLY))
    is_doubtful[0] = False
    doubtful = is_doubtful.take(labels)
    is_small = ~is_doubtful & (of.area < SMALL * disparity.size)
    is_small[0] = False
    if not is_small.any():
        return np.asarray(doubtful)
    small = is_small.take(labels)
    surroundings = _share_of_rest(water.shown | doubtful, small)
    empty = np.bincount(labels[small], surroundings[small], minlength=len(pieces)) / np.maximum(of.area, 1)
    lost = (((empty > ISLAND) | (far > MOSTLY)) & (faint > MOSTLY)) | (trust < LEAST_CONFIDENCE + ALONE * empty)
    return np.asarray((is_doubtful | (is_small & lost)).take(labels))


class _Piece(NamedTuple):
    """Sums over each piece, (N,) float64."""

    area: NDArray[np.float64]
    trust: NDArray[np.float64]
    faint: NDArray[np.float64]
    near: NDArray[np.float64]
    far: NDArray[np.float64]


@kernel(allocates=False)
def _add_up(
    disparity: FloatImage,
    confidence: FloatImage,
    faint: Mask,
    labels: NDArray[np.int32],
    low: float,
    high: float,
    pieces: NDArray[np.float64],
) -> None:
    """Add each pixel to its piece; what lies under `low` px is far, what lies over `high` px near."""
    height, width = disparity.shape
    for v in range(height):
        for u in range(width):
            piece = pieces[labels[v, u]]
            piece[0] += 1
            piece[1] += confidence[v, u]
            piece[2] += faint[v, u]
            piece[3] += disparity[v, u] > high
            piece[4] += disparity[v, u] < low


def _share_of_rest(empty: Mask, small: Mask) -> FloatImage:
    """Share of `empty` around each pixel, in what is no small piece itself."""
    part, rest = (share_around(mask, AROUND) for mask in (empty, ~small))
    return np.asarray(part / np.maximum(rest, np.float32(1e-3)), np.float32)
