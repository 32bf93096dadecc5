"""The surface seen from straight above: heights on a grid, and what follows from them."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter

from uw_recon_ros.jit import kernel
from uw_recon_ros.types import FloatImage, Matrix


@dataclass(frozen=True)
class MapGrid:
    """Cells of a map, north up.

    Parameters
    ----------
    west, north : float
        Outer corner of the top-left cell, m in the world.
    cell : float
        Edge, m.
    columns, rows : int
    """

    west: float
    north: float
    cell: float
    columns: int
    rows: int

    def centres(self) -> tuple[Matrix, Matrix]:
        """x (columns,) and y (rows,) of the cells' centres, m."""
        across, down = np.arange(self.columns, dtype=np.float64), np.arange(self.rows, dtype=np.float64)
        x: Matrix = self.west + self.cell * (across + 0.5)
        y: Matrix = self.north - self.cell * (down + 0.5)
        return x, y


@kernel(allocates=False)
def _look_down(
    vertices: Matrix, faces: NDArray[np.int32], west: float, north: float, cell: float, heights: FloatImage
) -> None:
    """Fill cells with the greatest height of the triangles over their centres."""
    rows, columns = heights.shape
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay = (vertices[a, 0] - west) / cell - 0.5, (north - vertices[a, 1]) / cell - 0.5
        bx, by = (vertices[b, 0] - west) / cell - 0.5, (north - vertices[b, 1]) / cell - 0.5
        cx, cy = (vertices[c, 0] - west) / cell - 0.5, (north - vertices[c, 1]) / cell - 0.5
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if abs(area) < 1e-12:
            continue
        for row in range(max(math.ceil(min(ay, min(by, cy))), 0), min(math.floor(max(ay, max(by, cy))) + 1, rows)):
            for column in range(
                max(math.ceil(min(ax, min(bx, cx))), 0), min(math.floor(max(ax, max(bx, cx))) + 1, columns)
            ):
                one = ((bx - column) * (cy - row) - (cx - column) * (by - row)) / area
                two = ((cx - column) * (ay - row) - (ax - column) * (cy - row)) / area
                three = 1.0 - one - two
                if one < -1e-9 or two < -1e-9 or three < -1e-9:
                    continue
                z = np.float32(one * vertices[a, 2] + two * vertices[b, 2] + three * vertices[c, 2])
                if not heights[row, column] >= z:
                    heights[row, column] = z


def heights_of(vertices: Matrix, faces: NDArray[np.int32], grid: MapGrid) -> FloatImage:
    """(rows, columns) height of the uppermost surface over each cell's centre, m; NaN: none."""
    heights = np.full((grid.rows, grid.columns), np.nan, np.float32)
    _look_down(vertices, faces, grid.west, grid.north, grid.cell, heights)
    return heights


def slopes(heights: FloatImage, cell: float) -> tuple[FloatImage, FloatImage]:
    """Slope to the east and to the north, one-sided beside gaps; NaN where neither side is known."""
    east, north = (_slope(heights, axis) / np.float32(cell) for axis in (1, 0))
    return east, -north


def _slope(heights: FloatImage, axis: int) -> FloatImage:
    step = np.diff(heights, axis=axis)
    gap = np.full_like(heights.take([0], axis=axis), np.nan)
    before, after = np.concatenate([gap, step], axis=axis), np.concatenate([step, gap], axis=axis)
    mean: FloatImage = (before + after) / 2
    return np.where(np.isfinite(mean), mean, np.where(np.isfinite(before), before, after)).astype(np.float32)


def normals_of(heights: FloatImage, cell: float) -> FloatImage:
    """(rows, columns, 3) upward unit normals; straight up where the slope is unknown."""
    east, north = (np.nan_to_num(slope, nan=0.0) for slope in slopes(heights, cell))
    normals = np.stack([-east, -north, np.ones_like(east)], axis=-1)
    return np.asarray(normals / np.linalg.norm(normals, axis=-1, keepdims=True), np.float32)


@dataclass(frozen=True, eq=False)
class Terrain:
    """What follows from heights, cell by cell; NaN where they are unknown.

    Parameters
    ----------
    area : (H, W) float32
        Of the surface over the cell, m^2.
    slope : (H, W) float32
        deg.
    rugosity : (H, W) float32
        Area of the surface over the area of the map, in a window around the cell; 1 is flat.
    """

    area: FloatImage
    slope: FloatImage
    rugosity: FloatImage


def terrain_of(heights: FloatImage, cell: float, window: int) -> Terrain:
    """Area, slope and rugosity; `window` is the side of the rugosity's window, cells."""
    east, north = slopes(heights, cell)
    steep = np.hypot(east, north)
    area = np.float32(cell * cell) * np.sqrt(1 + np.square(steep))
    known = np.isfinite(area)
    total = uniform_filter(np.where(known, area, 0).astype(np.float64), window, mode="constant")
    count = uniform_filter(known.astype(np.float64), window, mode="constant")
    with np.errstate(divide="ignore", invalid="ignore"):
        rugosity = np.where(known, total / (count * cell * cell), np.nan)
    return Terrain(
        area.astype(np.float32), np.degrees(np.arctan(steep)).astype(np.float32), rugosity.astype(np.float32)
    )
