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
    disparity = np.ascontiguousarray(disparity, np.float32)
    speckles = np.empty(disparity.shape, np.bool_)
    _mark_small(disparity, label_pieces(disparity, max_jump_px), min_area_px, speckles)
    return speckles


@kernel
def _mark_small(disparity: FloatImage, labels: NDArray[np.int32], min_area: int, speckles: Mask) -> None:
    height, width = labels.shape
    area = np.zeros(height * width, np.int32)
    for v in range(height):
        for u in range(width):
            area[labels[v, u]] += 1
    for v in range(height):
        for u in range(width):
            speckles[v, u] = area[labels[v, u]] < min_area and np.isfinite(disparity[v, u])
