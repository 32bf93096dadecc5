"""Depth maps into voxels: a weighted mean of truncated signed distances along the ray (Curless and Levoy, 1996).

What a depth says of a voxel is ``depth - z``: positive before the surface, negative behind it. Within the truncation,
some sigmas of the depth wide, it is averaged with the weight ``1 / sigma^2``; farther before the surface the voxel was
seen to be empty, which counts as the truncation itself, so that what has moved on is voted out; farther behind, nothing
is known.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.fuse.blocks import BLOCK, Keys, unpack
from uw_recon_ros.fuse.frame import View
from uw_recon_ros.jit import kernel
from uw_recon_ros.types import FloatImage, Matrix

_VOXELS = BLOCK**3
_ONE_SURFACE = 4.0  # sigmas between neighbouring depths that may be interpolated, beside the slope below
_SLOPE = 3.0  # of a surface that is interpolated, depth over lateral distance
_EXACT = 0.2  # of a voxel: a sigma below this is not believed


@dataclass(frozen=True, eq=False)
class Volume:
    """Voxels of some blocks.

    Parameters
    ----------
    keys : (N,) int64
        Sorted names of the blocks; voxel (i, j, k) of a block stands at index ``64 i + 8 j + k``.
    voxel : float
        Edge, m; voxel (i, j, k) of the world is the point ``voxel * (i, j, k)``.
    distance : (N, 512) float32
        Mean signed distance, m, positive before the surface.
    weight : (N, 512) float32
        Sum of ``1 / sigma^2``, 1/m^2; 0 = never seen.
    square : (N, 512) float32
        Weighted sum of squared distances.
    views : (N, 512) uint16
        Depth maps that saw the surface near the voxel.
    """

    keys: Keys
    voxel: float
    distance: FloatImage
    weight: FloatImage
    square: FloatImage
    views: NDArray[np.uint16]

    def add(self, view: View, band: Matrix) -> None:
        """Let a depth map speak; `band` as in `touched_blocks`."""
        _integrate(
            unpack(self.keys), self.voxel, band, view.depth, view.sigma, view.lens, view.motion,
            self.distance, self.weight, self.square, self.views,
        )  # fmt: skip


def empty_volume(keys: Keys, voxel: float) -> Volume:
    """Blocks that nothing is known about yet."""
    distance, weight, square = (np.zeros((len(keys), _VOXELS), np.float32) for _ in range(3))
    return Volume(keys, voxel, distance, weight, square, np.zeros((len(keys), _VOXELS), np.uint16))


@kernel(allocates=False)
def _is_outside(x: float, y: float, z: float, radius: float, lens: Matrix, rows: int, columns: int) -> bool:
    """Whether a ball in the camera's frame is out of the picture."""
    if z < -radius:
        return True
    left, right = lens[2] + 0.5, columns - 0.5 - lens[2]
    top, bottom = lens[3] + 0.5, rows - 0.5 - lens[3]
    return bool(
        lens[0] * x + left * z < -radius * math.hypot(lens[0], left)
        or right * z - lens[0] * x < -radius * math.hypot(lens[0], right)
        or lens[1] * y + top * z < -radius * math.hypot(lens[1], top)
        or bottom * z - lens[1] * y < -radius * math.hypot(lens[1], bottom)
    )


@kernel(allocates=False)
def _depth_at(depth: FloatImage, sigma: FloatImage, u: float, v: float, focal: float) -> tuple[float, float]:
    """Depth and sigma at a place: interpolated within one surface, else of the nearest pixel; NaN: none."""
    rows, columns = depth.shape
    column, row = int(u + 0.5), int(v + 0.5)
    nearest, spread = float(depth[row, column]), float(sigma[row, column])
    i, j = int(u), int(v)
    if not nearest > 0.0 or i + 1 >= columns or j + 1 >= rows:
        return nearest, spread
    a, b, c, d = depth[j, i], depth[j, i + 1], depth[j + 1, i], depth[j + 1, i + 1]
    low, high = min(min(a, b), min(c, d)), max(max(a, b), max(c, d))
    if not (high - low <= _ONE_SURFACE * spread + _SLOPE * nearest / focal) or not (a + b + c + d > 0.0):
        return nearest, spread
    x, y = u - i, v - j
    return (1 - y) * ((1 - x) * a + x * b) + y * ((1 - x) * c + x * d), spread


@kernel(allocates=False)
def _integrate(
    blocks: Keys, voxel: float, band: Matrix, depth: FloatImage, sigma: FloatImage, lens: Matrix, motion: Matrix,
    distance: FloatImage, weight: FloatImage, square: FloatImage, views: NDArray[np.uint16],
) -> None:  # fmt: skip
    rows, columns = depth.shape
    half = 0.5 * (BLOCK - 1) * voxel
    radius = math.sqrt(3.0) * half
    m = motion
    for b in range(len(blocks)):
        ox, oy, oz = (BLOCK * voxel * blocks[b, 0], BLOCK * voxel * blocks[b, 1], BLOCK * voxel * blocks[b, 2])
        cx, cy, cz = ox + half, oy + half, oz + half
        if _is_outside(
            m[0, 0] * cx + m[0, 1] * cy + m[0, 2] * cz + m[0, 3], m[1, 0] * cx + m[1, 1] * cy + m[1, 2] * cz + m[1, 3],
            m[2, 0] * cx + m[2, 1] * cy + m[2, 2] * cz + m[2, 3], radius, lens, rows, columns,
        ):  # fmt: skip
            continue
        for index in range(_VOXELS):
            wx, wy = ox + voxel * (index // 64), oy + voxel * (index // 8 % 8)
            wz = oz + voxel * (index % 8)
            z = m[2, 0] * wx + m[2, 1] * wy + m[2, 2] * wz + m[2, 3]
            if z <= voxel:
                continue
            u = lens[0] * (m[0, 0] * wx + m[0, 1] * wy + m[0, 2] * wz + m[0, 3]) / z + lens[2]
            v = lens[1] * (m[1, 0] * wx + m[1, 1] * wy + m[1, 2] * wz + m[1, 3]) / z + lens[3]
            if not (u >= 0.0 and v >= 0.0 and u <= columns - 1 and v <= rows - 1):
                continue
            measured, spread = _depth_at(depth, sigma, u, v, lens[0])
            if not measured > 0.0:
                continue
            limit = min(max(band[0] * spread, band[1]), band[2])
            ahead = measured - z
            if ahead < -limit:
                continue
            if ahead > limit:
                ahead = limit
            else:
                views[b, index] += np.uint16(views[b, index] < np.uint16(65535))
            spread = max(spread, _EXACT * voxel)
            one = 1.0 / (spread * spread)
            total = weight[b, index] + one
            distance[b, index] += np.float32(one / total * (ahead - distance[b, index]))
            square[b, index] += np.float32(one * ahead * ahead)
            weight[b, index] = np.float32(total)
