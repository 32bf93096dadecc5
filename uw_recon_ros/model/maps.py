"""The dive from above: orthomosaic, elevation and what follows from it, as GeoTIFF, in bounded memory."""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.fuse.blocks import BLOCK, TILE, Keys
from uw_recon_ros.fuse.layout import Layout
from uw_recon_ros.georeference.geotiff import Placement, write_geotiff
from uw_recon_ros.model.colors import Column
from uw_recon_ros.model.surface import Found, columns_of
from uw_recon_ros.model.work import TileTask
from uw_recon_ros.texturing.raster import Terrain, terrain_of
from uw_recon_ros.types import ByteImage, FloatImage

_VOXELS = BLOCK * TILE
_COARSER = (4.0, 2.0, 1.0, 1 / 2, 1 / 3, 1 / 4, 1 / 6, 1 / 8, 1 / 12, 1 / 16, 1 / 24, 1 / 32)  # whole pixels a tile
_AT_ONCE = 512  # rows
_PAGE_SIDE = 1600  # px of the maps on a page


@dataclass(frozen=True, eq=False)
class Overview:
    """The maps, coarse and cut to what is known, for people.

    Parameters
    ----------
    color : (H, W, 4) uint8
        RGB and opacity, north up.
    heights : (H, W) float32
        m; NaN = unknown.
    pixel : float
        m.
    west, north : float
        Outer corner in the coordinate system, m.
    """

    color: ByteImage
    heights: FloatImage
    pixel: float
    west: float
    north: float


@dataclass(frozen=True, eq=False)
class Mapped:
    """What the maps show.

    Parameters
    ----------
    files : tuple of str
    pixel, cell : float
        Of orthomosaic and elevation, m.
    west, north : float
        Outer corner of both, in the coordinate system, m.
    cells : (rows, columns)
        Of the elevation.
    area : float
        Of the map that is covered, m^2.
    shown : float
        Share of that with a picture, 0 to 1.
    completeness : float
        Share of the cells within the outline of the known ones that have a height, 0 to 1.
    overview : Overview
    """

    files: tuple[str, ...]
    pixel: float
    cell: float
    west: float
    north: float
    cells: tuple[int, int]
    area: float
    shown: float
    completeness: float
    overview: Overview

    def as_dict(self) -> dict[str, Any]:
        """For ``model.json``."""
        return {
            "cell": self.cell, "cells": list(self.cells), "west": self.west, "north": self.north,
            "orthomosaic_cell": self.pixel, "area": self.area, "coloured_share": self.shown,
            "completeness": self.completeness,
        }  # fmt: skip


def pixels_a_voxel(layout: Layout, wanted: int, limit: int) -> float:
    """As many as wanted, or as keep the map within a limit of pixels."""
    rows, columns = _extent(columns_of(layout))
    fitting = [k for k in _COARSER if k <= wanted and rows * columns * (k * _VOXELS) ** 2 <= limit]
    return fitting[0] if fitting else _COARSER[-1]


def _extent(columns: Keys) -> tuple[int, int]:
    """Tiles from south to north and from west to east."""
    east, north = columns.max(axis=0) - columns.min(axis=0) + 1
    return int(north), int(east)


def write_maps(task: TileTask, found: Found, colored: partial[Column], per_voxel: float) -> Mapped:
    """Write all maps from the columns."""
    layout, finest = found.layout, min(1.0, per_voxel)
    color = _assembled(task, layout, colored, "color", round(_VOXELS * per_voxel))
    heights = _assembled(task, layout, colored, "heights", round(_VOXELS * finest))
    pixel, cell = layout.voxel / per_voxel, layout.voxel / finest
    write_geotiff(
        task.folder / "orthomosaic.tif", color, _placed(task, layout, pixel), alpha=True,
        description="orthomosaic: best view of each place, RGB and mask",
    )  # fmt: skip
    place = _placed(task, layout, cell)
    nodata = float("nan")
    write_geotiff(
        task.folder / "elevation.tif", heights, place, nodata=nodata, description="elevation of the uppermost surface"
    )
    files = ["orthomosaic.tif", "elevation.tif"]
    if task.params.terrain == "yes":
        files += _write_terrain(task, heights, place, max(2, round(task.params.rugosity_window * finest)))
    covered, within = _counted(heights)
    shown = sum(int((rows[..., 3] > 0).sum()) for rows in _bands(color)) * (pixel / cell) ** 2
    return Mapped(
        tuple(files), pixel, cell, place.west, place.north, (heights.shape[0], heights.shape[1]), covered * cell**2,
        min(1.0, shown / max(covered, 1)), covered / max(within, 1),
        _overview(color, heights, pixel, place),
    )  # fmt: skip


def _overview(color: ByteImage, heights: FloatImage, pixel: float, place: Placement) -> Overview:
    """As many of the pixels as a page has room for, within the known ones."""
    step = max(1, -(-max(color.shape[:2]) // _PAGE_SIDE))
    coarse = np.ascontiguousarray(color[step // 2 :: step, step // 2 :: step])
    rows, columns = (_span(coarse[..., 3].max(axis=axis) > 0) for axis in (1, 0))
    v, u = (np.arange(s.start, s.stop) * step + step // 2 for s in (rows, columns))
    ratio = heights.shape[0] / color.shape[0]
    found = np.asarray(heights[np.ix_((v * ratio).astype(int), (u * ratio).astype(int))])
    side = step * pixel
    west, north = place.west + columns.start * side, place.north - rows.start * side
    return Overview(np.ascontiguousarray(coarse[rows, columns]), found, side, west, north)


def _span(known: NDArray[np.bool_]) -> slice:
    """From the first to the last known one; all of them where none is."""
    where = np.flatnonzero(known)
    return slice(int(where[0]), int(where[-1]) + 1) if len(where) else slice(0, len(known))


def _counted(heights: FloatImage) -> tuple[int, int]:
    """How many cells are known, and how many lie within the outline: between the first and the last known one of their
    row and of their column. Band by band, for the whole may be larger than the memory.
    """
    count, first, last = 0, np.full(heights.shape[1], len(heights)), np.full(heights.shape[1], -1)
    for top, band in zip(range(0, len(heights), _AT_ONCE), _bands(heights), strict=True):
        known = np.isfinite(band)
        count += int(known.sum())
        filled = np.flatnonzero(known.any(axis=0))
        first[filled] = np.minimum(first[filled], top + known[:, filled].argmax(axis=0))
        last[filled] = np.maximum(last[filled], top + len(band) - 1 - known[::-1, filled].argmax(axis=0))
    within = 0
    for top, band in zip(range(0, len(heights), _AT_ONCE), _bands(heights), strict=True):
        known, row = np.isfinite(band), top + np.arange(len(band))[:, None]
        inside = np.maximum.accumulate(known, axis=1) & np.maximum.accumulate(known[:, ::-1], axis=1)[:, ::-1]
        within += int((inside & (row >= first) & (row <= last)).sum())
    return count, within


def _bands(raster: NDArray[Any]) -> Iterator[NDArray[Any]]:
    return (np.asarray(raster[v : v + _AT_ONCE]) for v in range(0, raster.shape[0], _AT_ONCE))


def _placed(task: TileTask, layout: Layout, pixel: float) -> Placement:
    columns = columns_of(layout)
    west, north = columns[:, 0].min() * layout.tile_edge, (columns[:, 1].max() + 1) * layout.tile_edge
    origin = task.world.origin
    return Placement(float(west + origin[0]), float(north + origin[1]), pixel, task.world.crs)


def _on_disk(path: Path, kind: np.dtype[Any], shape: tuple[int, ...]) -> NDArray[Any]:
    """An array in a file, mapped into memory; its room on the disk is taken first, for a write that finds none kills.

    Raises
    ------
    OSError
        The disk has no room for it.
    """
    whole: NDArray[Any] = np.lib.format.open_memmap(str(path), "w+", kind, shape)
    with path.open("r+b") as file:
        os.posix_fallocate(file.fileno(), 0, path.stat().st_size)
    return whole


def _assembled(task: TileTask, layout: Layout, colored: partial[Column], name: str, side: int) -> NDArray[Any]:
    """One part of all columns in its place, in a file that is mapped into memory."""
    columns = columns_of(layout)
    rows, across = _extent(columns)
    first = getattr(colored(columns[0]), name)
    whole = _on_disk(task.work / f"{name}.npy", first.dtype, (rows * side, across * side, *first.shape[2:]))
    if first.dtype == np.float32:
        for band in range(0, whole.shape[0], _AT_ONCE):
            whole[band : band + _AT_ONCE] = np.nan
    for column in columns:
        v, u = side * (columns[:, 1].max() - column[1]), side * (column[0] - columns[:, 0].min())
        part = getattr(colored(column), name)
        if name == "heights":
            part = part + np.float32(task.world.origin[2])
        whole[v : v + side, u : u + side] = part
    return whole


def _write_terrain(task: TileTask, heights: FloatImage, place: Placement, window: int) -> list[str]:
    parts = {
        name: _on_disk(task.work / f"{name}.npy", np.dtype(np.float32), heights.shape)
        for name in ("area", "slope", "rugosity")
    }
    for first, band in _with_margin(heights, window, place.pixel):
        for name, whole in parts.items():
            rows = getattr(band, name)
            whole[first : first + len(rows)] = rows
    for name, whole in parts.items():
        write_geotiff(task.folder / f"{name}.tif", whole, place, nodata=float("nan"), description=_MEANING[name])
    return [f"{name}.tif" for name in parts]


_MEANING = {
    "area": "area of the surface over each cell, m^2",
    "slope": "slope, deg",
    "rugosity": "area of the surface over that of the map, in a window",
}


def _with_margin(heights: FloatImage, window: int, cell: float) -> Iterator[tuple[int, Terrain]]:
    """Terrain band by band, each worked out with the rows around it: first row and the band's own."""
    for first in range(0, len(heights), _AT_ONCE):
        start = max(first - window, 0)
        found = terrain_of(np.asarray(heights[start : first + _AT_ONCE + window]), cell, window)
        own = slice(first - start, first - start + _AT_ONCE)
        yield first, Terrain(found.area[own], found.slope[own], found.rugosity[own])
