"""Blocks of 8x8x8 voxels along the surface: names of places in one integer, and which blocks a view touches."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.types import ByteImage, FloatImage, Matrix

SIDE = 8  # voxels
_BITS = 20
_HALF = 1 << (_BITS - 1)
_SAMPLES = 5  # along a ray through the truncation
_MARGIN = 1.5  # voxels around a sample whose blocks are made too: a cell needs its neighbours
Keys = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class View:
    """A depth map and where it was taken.

    Parameters
    ----------
    depth, sigma : (H, W) float32
        Along the optical axis, m; NaN = invalid.
    color : (H, W, 3) uint8
        RGB.
    pose : (4, 4) float64
        World <- camera, m.
    intrinsics : (4,) float64
        fx, fy, cx, cy, px.
    """

    depth: FloatImage
    sigma: FloatImage
    color: ByteImage
    pose: Matrix
    intrinsics: Matrix


def keys_of(coordinates: NDArray[np.int64]) -> Keys:
    """(N,) one integer of each of (N, 3) whole coordinates within +-2^19, in the order of x, y, z.

    Raises
    ------
    ValueError
        A coordinate is beyond: too large a dive for so small a voxel.
    """
    moved = coordinates + _HALF
    if moved.size and not (moved.min() >= 0 and moved.max() < 2 * _HALF):
        raise ValueError(f"coordinates: expected within {_HALF} of 0, got {np.abs(coordinates).max()}")
    return (moved[:, 0] << (2 * _BITS)) | (moved[:, 1] << _BITS) | moved[:, 2]


def coordinates_of(keys: Keys) -> NDArray[np.int64]:
    """(N, 3) whole coordinates of (N,) keys."""
    mask = (1 << _BITS) - 1
    return np.stack([keys >> (2 * _BITS), (keys >> _BITS) & mask, keys & mask], axis=1) - _HALF


def points_of_view(view: View, max_sigma_m: float, step: int) -> tuple[Matrix, Matrix]:
    """(N, 3) world points of every `step`-th pixel, and (N, 3) rays, world, of depth 1."""
    depth = view.depth[::step, ::step].astype(np.float64)
    good = np.isfinite(depth) & (view.sigma[::step, ::step] <= max_sigma_m)
    v, u = np.nonzero(good)
    fx, fy, cx, cy = view.intrinsics
    rays = np.stack([(u * step - cx) / fx, (v * step - cy) / fy, np.ones(len(u))], axis=1) @ view.pose[:3, :3].T
    return rays * depth[good][:, None] + view.pose[:3, 3], rays


def touched_blocks(view: View, voxel_m: float, truncation_m: float, max_sigma_m: float) -> Keys:
    """(N,) sorted keys of the blocks that lie within the truncation of what a view sees."""
    known = view.depth[np.isfinite(view.depth)]
    if not known.size:
        return np.zeros(0, np.int64)
    step = max(1, int(voxel_m * view.intrinsics[0] / float(np.median(known))))
    points, rays = points_of_view(view, max_sigma_m, step)
    found = [np.zeros(0, np.int64)]
    for along in np.linspace(-truncation_m, truncation_m, _SAMPLES):
        sample = (points + along * rays) / voxel_m
        low = np.floor((sample - _MARGIN) / SIDE).astype(np.int64)
        high = np.floor((sample + _MARGIN) / SIDE).astype(np.int64)
        pairs = np.unique(np.hstack([low, high]), axis=0)
        for corner in range(8):
            chosen = [corner >> axis & 1 for axis in range(3)]
            found.append(keys_of(np.stack([pairs[:, axis + 3 * chosen[axis]] for axis in range(3)], axis=1)))
    return np.unique(np.concatenate(found))
