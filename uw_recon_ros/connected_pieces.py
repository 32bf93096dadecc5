"""Connected pieces of a disparity map."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.types import FloatImage


def label_pieces(disparity: FloatImage, max_jump_px: float) -> NDArray[np.int32]:
    """Number the pieces.

    Parameters
    ----------
    disparity : (H, W) float32
        px; NaN = invalid.
    max_jump_px : float
        Two 4-neighbours belong together when they differ by no more.

    Returns
    -------
    (H, W) int32
        The same number all over a piece, from 1 on without a gap; 0 where invalid.
    """
    return _label(np.ascontiguousarray(disparity, np.float32), np.float32(max_jump_px))


@kernel
def _root(parent: NDArray[np.int32], index: int) -> int:
    while parent[index] != index:
        parent[index] = parent[parent[index]]
        index = parent[index]
    return index


@kernel
def _join(parent: NDArray[np.int32], a: int, b: int) -> None:
    a, b = _root(parent, a), _root(parent, b)
    if a < b:
        parent[b] = a
    else:
        parent[a] = b


@kernel
def _label(disparity: FloatImage, max_jump: np.float32) -> NDArray[np.int32]:
    """Union-find over 4-neighbours, then numbers in the order of the pieces' first pixels. NaN joins nothing."""
    height, width = disparity.shape
    parent = np.arange(height * width).astype(np.int32)
    for v in range(height):
        for u in range(width):
            here = v * width + u
            left = u > 0 and abs(disparity[v, u] - disparity[v, u - 1]) <= max_jump
            above = v > 0 and abs(disparity[v, u] - disparity[v - 1, u]) <= max_jump
            if left:
                parent[here] = parent[here - 1]
                beyond = disparity[v - 1, u - 1] if v > 0 else np.float32(np.nan)
                # a square of four that hang together: joined when the pixel before was
                above &= not (
                    abs(disparity[v, u - 1] - beyond) <= max_jump and abs(disparity[v - 1, u] - beyond) <= max_jump
                )
            if above:
                _join(parent, here, here - width)
    number, flat = np.int32(0), disparity.ravel()
    for index in range(height * width):
        if not np.isfinite(flat[index]):
            parent[index] = 0
        elif parent[index] == index:
            number += 1
            parent[index] = number
        else:
            parent[index] = parent[parent[index]]
    return parent.reshape(height, width)
