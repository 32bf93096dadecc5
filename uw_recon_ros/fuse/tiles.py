"""Fusion tile by tile: only the blocks of one tile, and only the views that touch it, are in memory at a time."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.fuse.blocks import SIDE, Keys, View, coordinates_of
from uw_recon_ros.fuse.extract import FusedMesh, extract, joined, without_islands
from uw_recon_ros.fuse.volume import Volume


@dataclass(frozen=True)
class Fusion:
    """How views are fused.

    Parameters
    ----------
    voxel_m, truncation_m, max_sigma_m : float
        As in `Volume`.
    tile_m : float
        Side of a tile, m.
    min_views : int
        As in `extract`.
    island_faces : int
        Connected parts of fewer triangles are left out.
    """

    voxel_m: float
    truncation_m: float
    max_sigma_m: float
    tile_m: float = 3.0
    min_views: int = 1
    island_faces: int = 50


def fuse(view_of: Callable[[int], View], touched: Sequence[Keys], how: Fusion) -> FusedMesh | None:
    """Fuse views into one surface; None where there is none.

    Parameters
    ----------
    view_of : callable
        Gives view k; called again for each tile.
    touched : sequence of (N,) int64
        What `touched_blocks` says of each view.
    how : Fusion
    """
    side = max(1, round(how.tile_m / (how.voxel_m * SIDE)))
    every = np.unique(np.concatenate([np.zeros(0, np.int64), *touched]))
    parts = [_tile(view_of, touched, every, corner, side, how) for corner in _corners(every, side)]
    parts = [part for part in parts if len(part.faces)]
    whole = without_islands(joined(parts), how.island_faces) if parts else None
    return whole if whole is not None and len(whole.faces) else None


def _corners(keys: Keys, side: int) -> NDArray[np.int64]:
    """(T, 2) lowest block coordinates x, y of the tiles."""
    return np.unique(coordinates_of(keys)[:, :2] // side, axis=0) * side


def _inside(keys: Keys, corner: NDArray[np.int64], side: int) -> NDArray[np.bool_]:
    offset = coordinates_of(keys)[:, :2] - corner
    return np.asarray(((offset >= 0) & (offset < side)).all(axis=1), np.bool_)


def _tile(
    view_of: Callable[[int], View], touched: Sequence[Keys], every: Keys, corner: NDArray[np.int64], side: int,
    how: Fusion,
) -> FusedMesh:  # fmt: skip
    keys = every[_inside(every, corner, side + 1)]  # and the next blocks, whose voxels the last cells need
    volume = Volume(keys, how.voxel_m, how.truncation_m, how.max_sigma_m)
    for k, own in enumerate(touched):
        if np.isin(own, keys, assume_unique=True).any():
            volume.integrate(view_of(k))
    return extract(volume, _inside(keys, corner, side), how.min_views)
