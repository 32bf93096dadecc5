"""What of space a dive fills, in bounded memory: its blocks, its tiles, and which frames each tile has to look at."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.fuse.blocks import BLOCK, TILE, Keys, blocks_in_tile, tiles_of, touched_blocks
from uw_recon_ros.fuse.frame import View
from uw_recon_ros.types import Matrix

_LEAST_BAND, _MOST_BAND = 3.0, 8.0  # voxels
_PIXELS_A_VOXEL = 2.0


@dataclass(frozen=True, eq=False)
class Layout:
    """How a dive is divided.

    Parameters
    ----------
    voxel : float
        m.
    band : (3,) float64
        See `blocks.touched_blocks`.
    keys : (N,) int64
        Sorted names of all blocks.
    tiles : (T, 3) int64
        Those with blocks of their own, sorted.
    reaches : (F, 2, 3) float64
        Least and greatest coordinates that each frame sees, m; NaN where it sees nothing.
    """

    voxel: float
    band: Matrix
    keys: Keys
    tiles: Keys
    reaches: Matrix

    @property
    def tile_edge(self) -> float:
        """m."""
        return BLOCK * TILE * self.voxel

    def frames_of(self, tile: Keys) -> NDArray[np.intp]:
        """Frames that may see a tile (3,), or a column of tiles (2,), in order."""
        axes = len(tile)
        low, high = tile * self.tile_edge, (tile + 1) * self.tile_edge + BLOCK * self.voxel
        with np.errstate(invalid="ignore"):
            meets = (self.reaches[:, 0, :axes] <= high) & (self.reaches[:, 1, :axes] >= low)
        return np.flatnonzero(meets.all(axis=1))

    def blocks_of(self, tile: Keys) -> Keys:
        """Names of the blocks that a tile works on."""
        return blocks_in_tile(self.keys, tile)


def round_step(length: float) -> float:
    """The next of 1, 2, 5 times a power of ten from 9 % below `length` on."""
    decade = 10.0 ** math.floor(math.log10(length))
    return float(f"{next(step * decade for step in (1, 2, 5, 10) if step * decade >= length / 1.1):.6g}")


def voxel_for(footprints: Sequence[float]) -> float:
    """Edge for pixels that are so large on the bottom, m."""
    return round_step(_PIXELS_A_VOXEL * float(np.median(footprints)))


def footprint_of(view: View) -> float:
    """Size of the median pixel on what it sees, m; NaN where it sees nothing."""
    seen = view.depth[np.isfinite(view.depth)]
    return float(np.median(seen) / view.lens[:2].mean()) if len(seen) else float("nan")


def band_of(voxel: float, sigmas: float) -> Matrix:
    """The truncation for voxels of a size."""
    return np.array([sigmas, _LEAST_BAND * voxel, _MOST_BAND * voxel])


def reach_of(view: View, margin: float) -> Matrix:
    """(2, 3) bounds of a view's pyramid down to its greatest depth, m; NaN where it sees nothing."""
    if not np.isfinite(view.depth).any():
        return np.full((2, 3), np.nan)
    deepest = float(np.nanmax(view.depth)) + margin
    rows, columns = view.depth.shape
    u, v = np.array([0.0, columns - 1, 0.0, columns - 1]), np.array([0.0, 0.0, rows - 1, rows - 1])
    rays = np.stack([(u - view.lens[2]) / view.lens[0], (v - view.lens[3]) / view.lens[1], np.ones(4)], axis=1)
    corners = np.vstack([(deepest * rays - view.motion[:, 3]) @ view.motion[:, :3], view.position])
    return np.stack([corners.min(axis=0) - margin, corners.max(axis=0) + margin])


class LayoutBuilder:
    """A layout from views handed over one by one.

    Parameters
    ----------
    voxel : float
        m.
    sigmas : float
        Of the truncation.
    """

    def __init__(self, voxel: float, sigmas: float) -> None:
        self.voxel, self.band = voxel, band_of(voxel, sigmas)
        self._keys, self._new, self._waiting = np.empty(0, np.int64), [np.empty(0, np.int64)], 0
        self._reaches: list[Matrix] = []

    def add(self, view: View) -> None:
        """Note what a frame sees."""
        self._reaches.append(reach_of(view, float(self.band[2])))
        self._new.append(touched_blocks(view, self.voxel, self.band))
        self._waiting += len(self._new[-1])
        if self._waiting > len(self._keys) + 100_000:  # seldom enough that merging costs nothing
            self._merge()

    def _merge(self) -> None:
        self._keys, self._new, self._waiting = np.unique(np.concatenate([self._keys, *self._new])), [], 0

    def finish(self) -> Layout:
        """The layout of all that was added."""
        self._merge()
        tiles = np.unique(tiles_of(self._keys), axis=0)
        return Layout(self.voxel, self.band, self._keys, tiles, np.array(self._reaches).reshape(-1, 2, 3))
