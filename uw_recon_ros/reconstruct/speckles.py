"""The small pieces of a disparity map."""

from __future__ import annotations

import numpy as np

from uw_recon_ros.pieces import label_pieces
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
    area = np.bincount(labels.ravel())
    speckles: Mask = (area[labels] < min_area_px) & np.isfinite(disparity)
    return speckles
