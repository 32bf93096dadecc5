"""The small pieces of a disparity map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.connected_pieces import label_pieces
from uw_recon_ros.jit import kernel
from uw_recon_ros.types import FloatImage, Mask


def find_speckles(disparity: FloatImage, max_jump_px: float, min_area_px: int) -> Mask:
    """Valid pixels that belong to no piece of at least `min_area_px` pixels.

    Parameters
    ----------
    disparity : (H, W) float32
        px; NaN = invalid.
    max_jump_px : float
        Two 4-neighbours belong together when they differ by no more.
    min_area_px : int
        Pieces smaller than this are speckles; 0 or 1: none are.

    Returns
    -------
    (H, W) bool
    """
    if min_area_px <= 1:
        return np.zeros(disparity.shape, np.bool_)
    labels = label_pieces(disparity, max_jump_px)
    speckles = np.empty(labels.shape, np.bool_)
    _mark_small(labels, min_area_px, np.zeros(int(labels.max()) + 1, np.int32), speckles)
    return speckles


@kernel(allocates=False)
def _mark_small(labels: NDArray[np.int32], min_area: int, area: NDArray[np.int32], speckles: Mask) -> None:
    height, width = labels.shape
    for v in range(height):
        for u in range(width):
            area[labels[v, u]] += 1
    area[0] = min_area
    for v in range(height):
        for u in range(width):
            speckles[v, u] = area[labels[v, u]] < min_area
