"""A signed distance in blocks of voxels, weighted by how sure each depth is; what is seen through is voted free.

After Curless and Levoy (1996), in hashed blocks as Niessner et al. (2013).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.fuse.blocks import SIDE, Keys, View, coordinates_of
from uw_recon_ros.jit import kernel
from uw_recon_ros.rigid import inverse
from uw_recon_ros.types import ByteImage, FloatImage, Matrix

_VOXELS = SIDE**3
_ONE_SURFACE = 0.02  # depths within this share of each other are interpolated
_LEAST_SIGMA = 0.1  # voxels: no pixel counts for more than one as sure as this


class Volume:
    """Blocks that were asked for, and what views say of them.

    Parameters
    ----------
    keys : (N,) int64
        Sorted; of the blocks, see `blocks.keys_of`.
    voxel_m : float
        Voxels stand at whole multiples of it.
    truncation_m : float
        Distances farther than this in front of a surface are free, behind it unknown.
    max_sigma_m : float
        Pixels less sure than this say nothing.

    Attributes
    ----------
    distance : (N, 512) float32
        Signed, m, positive towards the cameras; voxel (x, y, z) of a block at ``(z * 8 + y) * 8 + x``.
    weight : (N, 512) float32
        Sum of 1 / sigma^2, 1/m^2; 0 = unseen.
    near : (N, 512) float32
        The share of it within the truncation.
    color : (N, 512, 3) float32
        Sum of colours times their weights.
    views : (N, 512) uint16
        Views within the truncation.
    """

    def __init__(self, keys: Keys, voxel_m: float, truncation_m: float, max_sigma_m: float) -> None:
        self.keys, self.voxel_m, self.truncation_m, self.max_sigma_m = keys, voxel_m, truncation_m, max_sigma_m
        self.coordinates = coordinates_of(keys)
        self.distance, self.weight, self.near = (np.zeros((len(keys), _VOXELS), np.float32) for _ in range(3))
        self.color = np.zeros((len(keys), _VOXELS, 3), np.float32)
        self.views = np.zeros((len(keys), _VOXELS), np.uint16)

    def integrate(self, view: View) -> None:
        """Add what a view says of all blocks."""
        _integrate(
            self.coordinates, self.distance, self.weight, self.near, self.color, self.views,
            np.ascontiguousarray(view.depth, np.float32), np.ascontiguousarray(view.sigma, np.float32),
            np.ascontiguousarray(view.color, np.uint8), np.ascontiguousarray(inverse(view.pose)[:3], np.float64),
            np.ascontiguousarray(view.intrinsics, np.float64),
            np.array([self.voxel_m, self.truncation_m, self.max_sigma_m, _LEAST_SIGMA * self.voxel_m]),
        )  # fmt: skip


@kernel
def _integrate(
    blocks: NDArray[np.int64],
    distance: FloatImage,
    weight: FloatImage,
    near: FloatImage,
    color: FloatImage,
    views: NDArray[np.uint16],
    depth: FloatImage,
    sigma: FloatImage,
    image: ByteImage,
    motion: Matrix,
    intrinsics: Matrix,
    settings: Matrix,
) -> None:
    voxel, truncation, max_sigma, least = settings[0], settings[1], settings[2], settings[3]
    fx, fy, cx, cy = intrinsics[0], intrinsics[1], intrinsics[2], intrinsics[3]
    height, width = depth.shape
    radius = voxel * SIDE * 0.87
    for n in range(len(blocks)):
        x0, y0, z0 = blocks[n, 0] * SIDE, blocks[n, 1] * SIDE, blocks[n, 2] * SIDE
        mx, my, mz = (x0 + 3.5) * voxel, (y0 + 3.5) * voxel, (z0 + 3.5) * voxel
        z = motion[2, 0] * mx + motion[2, 1] * my + motion[2, 2] * mz + motion[2, 3]
        if z < radius:
            continue
        x = motion[0, 0] * mx + motion[0, 1] * my + motion[0, 2] * mz + motion[0, 3]
        y = motion[1, 0] * mx + motion[1, 1] * my + motion[1, 2] * mz + motion[1, 3]
        u, v, reach = fx * x / z + cx, fy * y / z + cy, 2.0 * max(fx, fy) * radius / z + 1.0
        if u < -reach or v < -reach or u > width + reach or v > height + reach:
            continue
        for k in range(_VOXELS):
            px, py, pz = (x0 + k % SIDE) * voxel, (y0 + k // SIDE % SIDE) * voxel, (z0 + k // (SIDE * SIDE)) * voxel
            z = motion[2, 0] * px + motion[2, 1] * py + motion[2, 2] * pz + motion[2, 3]
            if z <= 0.0:
                continue
            u = fx * (motion[0, 0] * px + motion[0, 1] * py + motion[0, 2] * pz + motion[0, 3]) / z + cx
            v = fy * (motion[1, 0] * px + motion[1, 1] * py + motion[1, 2] * pz + motion[1, 3]) / z + cy
            column, row = int(np.floor(u + 0.5)), int(np.floor(v + 0.5))
            if column < 0 or row < 0 or column >= width or row >= height:
                continue
            s = sigma[row, column]
            d = _depth_at(depth, u, v, row, column)
            if not (s <= max_sigma) or not (d > 0.0) or d - z < -truncation:
                continue
            w = 1.0 / max(s, least) ** 2
            total = weight[n, k] + w
            distance[n, k] += (min(d - z, truncation) - distance[n, k]) * w / total
            weight[n, k] = total
            if d - z < truncation:
                near[n, k] += w
                views[n, k] += 1
                for c in range(3):
                    color[n, k, c] += w * image[row, column, c]


@kernel(inline=True, allocates=False)
def _depth_at(depth: FloatImage, u: float, v: float, row: int, column: int) -> float:
    """Bilinear on one surface, of the nearest pixel elsewhere."""
    nearest = float(depth[row, column])
    left, top = int(np.floor(u)), int(np.floor(v))
    if left < 0 or top < 0 or left + 1 >= depth.shape[1] or top + 1 >= depth.shape[0]:
        return nearest
    a, b = float(depth[top, left]), float(depth[top, left + 1])
    c, d = float(depth[top + 1, left]), float(depth[top + 1, left + 1])
    low, high = min(min(a, b), min(c, d)), max(max(a, b), max(c, d))
    if not (high - low < _ONE_SURFACE * nearest) or not (a + b + c + d > 0.0):
        return nearest
    x, y = u - left, v - top
    return (a * (1 - x) + b * x) * (1 - y) + (c * (1 - x) + d * x) * y
