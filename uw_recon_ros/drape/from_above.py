"""The surface seen from straight above: highest point of each cell, and its colour in the view that shows it best."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.rigid import inverse
from uw_recon_ros.types import ByteImage, FloatImage, Matrix

_BORDER = 2.0  # px at an image's rim that are not taken


@dataclass(frozen=True)
class Grid:
    """Cells over the ground, row 0 in the north (y up), column 0 in the west.

    Parameters
    ----------
    west, north : float
        Outer edges of cell (0, 0), m, in the world less its origin.
    cell_m : float
    rows, columns : int
    """

    west: float
    north: float
    cell_m: float
    rows: int
    columns: int


def grid_over(points: Matrix, cell_m: float, most_cells: int) -> Grid:
    """Cells over all points (N, 3), edges at whole multiples of their size; the size is doubled until they are few.

    Raises
    ------
    ValueError
        No point.
    """
    if not len(points):
        raise ValueError("points: expected at least one, got none")
    low, high = points[:, :2].min(axis=0), points[:, :2].max(axis=0)
    while True:
        first, last = np.floor(low / cell_m).astype(int), np.floor(high / cell_m).astype(int) + 1
        columns, rows = (int(n) for n in last - first)
        if rows * columns <= most_cells:
            return Grid(float(first[0] * cell_m), float(last[1] * cell_m), cell_m, rows, columns)
        cell_m *= 2


def elevation(vertices: Matrix, faces: NDArray[np.int32], grid: Grid) -> FloatImage:
    """(rows, columns) float32 height z of the highest triangle over each cell's centre, m; NaN = none."""
    heights = np.full((grid.rows, grid.columns), np.nan, np.float32)
    places = np.empty_like(vertices)
    places[:, 0] = (vertices[:, 0] - grid.west) / grid.cell_m - 0.5
    places[:, 1] = (grid.north - vertices[:, 1]) / grid.cell_m - 0.5
    places[:, 2] = vertices[:, 2]
    _fill(places, faces, heights)
    return heights


@kernel
def _fill(places: Matrix, faces: NDArray[np.int32], heights: FloatImage) -> None:
    rows, columns = heights.shape
    for m in range(len(faces)):
        a, b, c = faces[m, 0], faces[m, 1], faces[m, 2]
        x0, y0, x1, y1, x2, y2 = places[a, 0], places[a, 1], places[b, 0], places[b, 1], places[c, 0], places[c, 1]
        area = (x1 - x0) * (y2 - y0) - (x2 - x0) * (y1 - y0)
        if area == 0.0:
            continue
        for row in range(max(0, np.ceil(min(y0, y1, y2))), min(rows - 1, np.floor(max(y0, y1, y2))) + 1):
            for column in range(max(0, np.ceil(min(x0, x1, x2))), min(columns - 1, np.floor(max(x0, x1, x2))) + 1):
                s = ((column - x0) * (y2 - y0) - (x2 - x0) * (row - y0)) / area
                t = ((x1 - x0) * (row - y0) - (column - x0) * (y1 - y0)) / area
                if s < 0.0 or t < 0.0 or s + t > 1.0:
                    continue
                z = (1.0 - s - t) * places[a, 2] + s * places[b, 2] + t * places[c, 2]
                if not (heights[row, column] >= z):
                    heights[row, column] = z


class Mosaic:
    """Colours of cells, each from the view whose middle it is nearest to; no colour is mixed from two views.

    Parameters
    ----------
    grid : Grid
    heights : (rows, columns) float32
        m; NaN = no cell.

    Attributes
    ----------
    colors : (rows, columns, 3) uint8
    best : (rows, columns) int32
        Which view, -1 = none.
    """

    def __init__(self, grid: Grid, heights: FloatImage) -> None:
        self.grid, self.heights = grid, heights
        self.colors = np.zeros((*heights.shape, 3), np.uint8)
        self.best = np.full(heights.shape, -1, np.int32)
        self._score = np.full(heights.shape, np.inf, np.float32)

    def add(
        self, number: int, color: ByteImage, depth: FloatImage, pose: Matrix, intrinsics: Matrix, tolerance_m: float
    ) -> None:
        """Offer a view; cells hidden from it (`depth` is nearer by more than `tolerance_m`) are not taken."""
        _offer(
            self.colors, self.best, self._score, self.heights, number, np.ascontiguousarray(color, np.uint8),
            np.ascontiguousarray(depth, np.float32), np.ascontiguousarray(inverse(pose)[:3], np.float64),
            np.ascontiguousarray(intrinsics, np.float64),
            np.array([self.grid.west, self.grid.north, self.grid.cell_m, tolerance_m]), self._window(depth, pose,
                                                                                                      intrinsics),
        )  # fmt: skip

    def _window(self, depth: FloatImage, pose: Matrix, intrinsics: Matrix) -> NDArray[np.int64]:
        """First and past-the-last row, column of what the view may show."""
        known = depth[np.isfinite(depth)]
        if not known.size:
            return np.zeros(4, np.int64)
        height, width = depth.shape
        fx, fy, cx, cy = intrinsics
        rays = np.array([[(u - cx) / fx, (v - cy) / fy, 1.0] for u in (0, width) for v in (0, height)])
        corners = np.concatenate([rays * float(z) for z in (known.min(), known.max())]) @ pose[:3, :3].T + pose[:3, 3]
        low, high = corners[:, :2].min(axis=0), corners[:, :2].max(axis=0)
        g = self.grid
        rows = np.clip(np.floor([(g.north - high[1]) / g.cell_m, (g.north - low[1]) / g.cell_m + 1]), 0, g.rows)
        columns = np.clip(np.floor([(low[0] - g.west) / g.cell_m, (high[0] - g.west) / g.cell_m + 1]), 0, g.columns)
        return np.concatenate([rows, columns]).astype(np.int64)


@kernel
def _offer(
    colors: ByteImage, best: NDArray[np.int32], score: FloatImage, heights: FloatImage, number: int, image: ByteImage,
    depth: FloatImage, motion: Matrix, intrinsics: Matrix, settings: Matrix, window: NDArray[np.int64],
) -> None:  # fmt: skip
    west, north, cell, tolerance = settings[0], settings[1], settings[2], settings[3]
    fx, fy, cx, cy = intrinsics[0], intrinsics[1], intrinsics[2], intrinsics[3]
    height, width = depth.shape
    for row in range(window[0], window[1]):
        for column in range(window[2], window[3]):
            pz = float(heights[row, column])
            if np.isnan(pz):
                continue
            px, py = west + (column + 0.5) * cell, north - (row + 0.5) * cell
            z = motion[2, 0] * px + motion[2, 1] * py + motion[2, 2] * pz + motion[2, 3]
            if z <= 0.0:
                continue
            x = (motion[0, 0] * px + motion[0, 1] * py + motion[0, 2] * pz + motion[0, 3]) / z
            y = (motion[1, 0] * px + motion[1, 1] * py + motion[1, 2] * pz + motion[1, 3]) / z
            u, v, off = fx * x + cx, fy * y + cy, x * x + y * y
            if not (_BORDER <= u < width - 1 - _BORDER) or not (_BORDER <= v < height - 1 - _BORDER):
                continue
            left, top = int(u), int(v)
            seen = float(depth[int(v + 0.5), int(u + 0.5)])
            hidden = not (abs(seen - z) <= tolerance)
            if hidden or off >= score[row, column]:
                continue
            a, b = u - left, v - top
            score[row, column], best[row, column] = off, number
            for c in range(3):
                above = (1 - a) * image[top, left, c] + a * image[top, left + 1, c]
                below = (1 - a) * image[top + 1, left, c] + a * image[top + 1, left + 1, c]
                colors[row, column, c] = np.uint8((1 - b) * above + b * below + 0.5)
