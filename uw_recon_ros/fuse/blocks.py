"""Where there is something to fuse: space in blocks of 8 x 8 x 8 voxels, found by the depth maps that touch them.

A block is named by one integer that holds its three coordinates; sorted arrays of names are all the bookkeeping.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.errors import ModelError
from uw_recon_ros.findings import Code
from uw_recon_ros.fuse.frame import View
from uw_recon_ros.jit import kernel
from uw_recon_ros.types import FloatImage, Matrix

#: Voxels a side of a block; blocks a side of a tile.
BLOCK, TILE = 8, 48
_BITS = 17  # of a block's coordinate: 5 km of 5 mm voxels
_HALF = 1 << (_BITS - 1)

Keys = NDArray[np.int64]


def pack(blocks: Keys) -> Keys:
    """Names (N,) of blocks (N, 3).

    Raises
    ------
    ModelError
        They reach farther from the origin than names can say.
    """
    if len(blocks) and (np.abs(blocks) >= _HALF - 1).any():
        raise ModelError(
            f"poses: expected within {_HALF} blocks of the origin, got {int(np.abs(blocks).max())}: "
            "subtract an origin from the poses, or take larger voxels",
            Code.MODEL_TOO_LARGE,
        )
    shifted = blocks + _HALF
    return np.asarray((shifted[:, 0] << 2 * _BITS) | (shifted[:, 1] << _BITS) | shifted[:, 2], np.int64)


def unpack(keys: Keys) -> Keys:
    """(N, 3) coordinates of named blocks."""
    mask = (1 << _BITS) - 1
    parts = np.stack([keys >> 2 * _BITS, (keys >> _BITS) & mask, keys & mask], axis=1)
    return np.asarray(parts - _HALF, np.int64)


@kernel
def _touch(
    depth: FloatImage, sigma: FloatImage, lens: Matrix, motion: Matrix, edge: float, band: Matrix, step: int,
    found: NDArray[np.int32],
) -> int:  # fmt: skip
    """Blocks that come near the points of every `step`-th pixel, some more than once; returns how many."""
    rows, columns = depth.shape
    count = 0
    for v in range(step // 2, rows, step):
        for u in range(step // 2, columns, step):
            z = float(depth[v, u])
            if not z > 0.0:
                continue
            reach = min(max(band[0] * sigma[v, u], band[1]), band[2])
            x, y = (u - lens[2]) / lens[0] * z - motion[0, 3], (v - lens[3]) / lens[1] * z - motion[1, 3]
            z -= motion[2, 3]
            wx = motion[0, 0] * x + motion[1, 0] * y + motion[2, 0] * z
            wy = motion[0, 1] * x + motion[1, 1] * y + motion[2, 1] * z
            wz = motion[0, 2] * x + motion[1, 2] * y + motion[2, 2] * z
            for i in range(math.floor((wx - reach) / edge), math.floor((wx + reach) / edge) + 1):
                for j in range(math.floor((wy - reach) / edge), math.floor((wy + reach) / edge) + 1):
                    for k in range(math.floor((wz - reach) / edge), math.floor((wz + reach) / edge) + 1):
                        if count < len(found):
                            found[count, 0], found[count, 1], found[count, 2] = i, j, k
                        count += 1
    return count


def touched_blocks(view: View, voxel: float, band: Matrix) -> Keys:
    """Sorted names of the blocks that a depth map says something about.

    Parameters
    ----------
    view : View
    voxel : float
        Edge of a voxel, m.
    band : (3,) float64
        Sigmas, and least and greatest distance (m), to which a depth counts on either side.
    """
    nearest = float(np.nanmin(view.depth)) if np.isfinite(view.depth).any() else 0.0
    spacing = max(float(np.nanmax(view.depth)), nearest) / view.lens[:2].min() if nearest else 1.0
    step = max(1, min(8, int(band[1] / spacing)))
    found = np.empty((1 << 16, 3), np.int32)
    while True:
        arguments = view.depth, view.sigma, view.lens, view.motion, BLOCK * voxel, band, step, found
        count = _touch(*arguments)
        if count <= len(found):
            return np.unique(pack(found[:count].astype(np.int64)))
        found = np.empty((count, 3), np.int32)


def tiles_of(keys: Keys) -> Keys:
    """(N, 3) tile that owns each block."""
    return np.asarray(np.floor_divide(unpack(keys), TILE), np.int64)


def blocks_in_tile(keys: Keys, tile: Keys) -> Keys:
    """Names of a tile's own blocks, and of the layer beyond its far faces that cells on the border reach into."""
    inside = ((unpack(keys) >= tile * TILE) & (unpack(keys) <= (tile + 1) * TILE)).all(axis=1)
    return keys[inside]


def neighbours(keys: Keys) -> NDArray[np.int32]:
    """(N, 8) index of the block at each of the offsets 0 or 1 in x (bit 0), y (bit 1), z (bit 2); -1: none."""
    blocks = unpack(keys)
    table = np.empty((len(keys), 8), np.int32)
    for bits in range(8):
        wanted = pack(blocks + np.array([bits & 1, bits >> 1 & 1, bits >> 2]))
        place = np.searchsorted(keys, wanted).clip(0, max(len(keys) - 1, 0))
        table[:, bits] = np.where(keys[place] == wanted, place, -1) if len(keys) else -1
    return table
