"""Colours of a dive: pictures balanced, then maps and vertices coloured column by column of tiles."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.fuse.blocks import BLOCK, TILE, Keys
from uw_recon_ros.fuse.frame import view_of
from uw_recon_ros.fuse.layout import Layout
from uw_recon_ros.model.surface import Found, column_patch, columns_of, patch_of
from uw_recon_ros.model.work import Arrays, TileTask
from uw_recon_ros.texturing.best_view import BestViews
from uw_recon_ros.texturing.gains import Balance, GainSample, balance_frames, look_at
from uw_recon_ros.texturing.raster import MapGrid, heights_of, normals_of
from uw_recon_ros.texturing.simplify import vertex_normals
from uw_recon_ros.types import ByteImage, FloatImage, Matrix

_PLACES_A_FRAME, _MOST_PLACES = 20, 20_000  # where pictures are compared
_SEEN_A_FRAME, _MOST_SEEN = 300, 300_000  # of them by each picture, by all: 0.4 kB each while it is solved
_SHUFFLE = 2_654_435_761  # Knuth's multiplier: an order without order
_TOLERANCE = 2.0  # voxels between surface and picture's depth, beside its sigma


def color_points(
    task: TileTask, found: Found, balance: Balance, points: Matrix, normals: FloatImage, numbers: NDArray[np.intp]
) -> BestViews:
    """Best views of places among some frames; the nearest first, for those after the best two cost little."""
    best = BestViews(points, normals, _TOLERANCE * found.layout.voxel)
    away = found.layout.reaches[numbers].mean(axis=1) - (points.mean(axis=0) if len(points) else 0.0)
    for number in numbers[np.argsort((away[:, :2] ** 2).sum(axis=1), kind="stable")].tolist():
        frame = task.frames[number]
        best.add(number, view_of(frame), frame.left, balance, float(found.sharpness[number]))
    return best


def balance_of(task: TileTask, found: Found) -> Balance:
    """Gains of all frames, from places all over the surface."""
    arrays = task.kept("balance", lambda: _balance(task, found))
    return Balance(arrays["gains"], arrays["field"])


def _balance(task: TileTask, found: Found) -> Arrays:
    tiles = found.layout.tiles
    wanted = min(_PLACES_A_FRAME * len(task.frames), _MOST_PLACES)
    counts = [len(patch_of(task, found, tile).vertices) for tile in tiles]
    step = max(1, sum(counts) // wanted)
    places = [patch_of(task, found, tile).vertices[::step] for tile in tiles]
    starts = np.cumsum([0, *(len(p) for p in places)])
    members = [set(found.layout.frames_of(tile).tolist()) for tile in tiles]

    most = max(1, min(_SEEN_A_FRAME, _MOST_SEEN // len(task.frames)))

    def seen_from(number: int) -> GainSample:
        near = [k for k, frames in enumerate(members) if number in frames]
        frame, tolerance = task.frames[number], _TOLERANCE * found.layout.voxel
        points = np.concatenate([np.empty((0, 3)), *(places[k] for k in near)])
        names = np.concatenate([np.empty(0, np.int64), *(np.arange(starts[k], starts[k + 1]) for k in near)])
        seen = look_at(points, number, view_of(frame), frame.left, tolerance)
        few = np.argsort(names[seen.place] * _SHUFFLE % 2**32, kind="stable")[:most]  # alike for pictures of one place
        return GainSample(names[seen.place][few], seen.frame[few], seen.level[few], seen.terms[few])

    seen = task.each("colours compared", seen_from, range(len(task.frames)))
    solved = balance_frames(seen, int(starts[-1]), len(task.frames))
    return {"gains": solved.gains, "field": solved.field}


@dataclass(frozen=True, eq=False)
class Column:
    """What is known of a column of tiles.

    Parameters
    ----------
    color : (H, W, 4) uint8
        RGB and whether a picture shows the cell; north up.
    heights : (h, w) float32
        m; NaN = unknown.
    vertex_colors : (N, 3) uint8
        Of the vertices of `surface.column_patch`.
    """

    color: ByteImage
    heights: FloatImage
    vertex_colors: ByteImage


def column_grid(layout: Layout, column: Keys, cells_a_voxel: float) -> MapGrid:
    """The cells over a column of tiles."""
    edge, cells = layout.tile_edge, round(BLOCK * TILE * cells_a_voxel)
    return MapGrid(float(column[0] * edge), float((column[1] + 1) * edge), edge / cells, cells, cells)


def column_of(task: TileTask, found: Found, balance: Balance, cells_a_voxel: float, column: Keys) -> Column:
    """Map and colours of a column, from the disk where they were made before."""
    name = "column_" + "_".join(str(k) for k in column.tolist())
    return Column(**task.kept(name, lambda: _column(task, found, balance, cells_a_voxel, column)))


def _column(task: TileTask, found: Found, balance: Balance, cells_a_voxel: float, column: Keys) -> Arrays:
    patch, layout = column_patch(task, found, column), found.layout
    grid = column_grid(layout, column, cells_a_voxel)
    fine = heights_of(patch.vertices, patch.faces, grid)
    there = np.isfinite(fine)
    x, y = np.meshgrid(*grid.centres())
    cells = np.stack([x[there], y[there], fine[there]], axis=1)
    points = np.concatenate([cells, patch.vertices])
    normals = np.concatenate([normals_of(fine, grid.cell)[there], vertex_normals(patch.vertices, patch.faces)])
    best = color_points(task, found, balance, points, normals, layout.frames_of(column))
    colors, seen = best.colors(), best.seen
    color = np.zeros((grid.rows, grid.columns, 4), np.uint8)
    color[there] = np.c_[colors, np.where(seen, 255, 0).astype(np.uint8)][: len(cells)]
    color[color[..., 3] == 0] = 0
    heights = heights_of(patch.vertices, patch.faces, column_grid(layout, column, min(1.0, cells_a_voxel)))
    return {"color": color, "heights": heights, "vertex_colors": colors[len(cells) :]}


def color_all(task: TileTask, found: Found, balance: Balance, cells_a_voxel: float) -> None:
    """Colour every column, so that `column_of` finds it."""
    make = partial(column_of, task, found, balance, cells_a_voxel)
    for _ in task.each("columns coloured", lambda column: make(column).color.shape, columns_of(found.layout)):
        pass
