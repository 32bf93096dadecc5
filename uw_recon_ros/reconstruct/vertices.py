"""Which pixels become vertices: many where the surface bends or breaks, few where it is flat.

Greedy insertion [1]_ in rounds: triangulate, let every triangle that departs from the depth map propose its worst
pixel, insert the proposals of the triangles that are wrong about most, until all fit or the budget is spent.

References
----------
.. [1] M. Garland and P. S. Heckbert, "Fast polygonal approximation of terrains and height fields", CMU-CS-95-181.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay

from uw_recon_ros.reconstruct.rasters import misfit
from uw_recon_ros.types import FloatImage, Mask

Ints = NDArray[np.int32]

_SEED_SPACING = 32  # px
_CAP = 8.0  # tolerances: a pixel across a jump counts no more than this, or jumps would eat the budget
_ENOUGH = 200  # a round that would add less than one vertex in so many is not worth another triangulation
_NEARLY = 0.95  # of the budget: nor is one for the rest
_WITH_GAPS = 1.5  # budgets, counting the vertices that only outline gaps
_GAP_LEVEL = 1000.0  # px below the lowest: invalid pixels are a surface far behind, whose border is a jump


def choose_vertices(
    level: FloatImage, closed: Mask | None = None, *, budget: int, tolerance: float
) -> tuple[Ints, Ints]:
    """Choose pixels whose Delaunay triangulation follows `level`.

    Parameters
    ----------
    level : (H, W) float32
        A quantity that planes are flat in (disparity), px; NaN = invalid.
    closed : (H, W) bool or None
        Invalid pixels that triangles may cover, but that cannot be vertices.
    budget : int
        Largest number of vertices on valid pixels, at least 4.
    tolerance : float
        Departure that needs no further vertex, px.

    Returns
    -------
    vertices : (N, 2) int32
        Pixels (u, v), some of them invalid.
    triangles : (M, 3) int32
        Counter-clockwise with u to the right and v *up*.
    """
    if level.ndim != 2 or min(level.shape) < 2 or budget < 4:
        raise ValueError(f"level, budget: expected at least 2x2 pixels and 4 vertices, got {level.shape} and {budget}")
    whole = _fill_gaps(level)
    chosen = _seed(level.shape[0], level.shape[1], budget)
    if closed is not None:
        whole[closed] = np.nan
        chosen = chosen[~closed.ravel()[chosen]]
    while True:
        vertices, triangles = _triangulate(chosen, level.shape[1])
        room = _room(int(np.isfinite(level.ravel()[chosen]).sum()), len(chosen), budget)
        proposals = _propose(whole, vertices, triangles, tolerance, room)
        if len(proposals) <= len(chosen) // _ENOUGH:
            return vertices, triangles
        chosen = np.union1d(chosen, proposals)


def _room(valid: int, chosen: int, budget: int) -> int:
    """Vertices that the next round may add: at most as many as there are, and none for a small rest of the budget."""
    room = min(budget - valid, int(_WITH_GAPS * budget) - chosen)
    return min(room, chosen) if room > (1 - _NEARLY) * budget else 0


def _fill_gaps(level: FloatImage) -> FloatImage:
    valid = np.isfinite(level)
    behind = (level[valid].min() if valid.any() else 0.0) - _GAP_LEVEL
    return np.where(valid, level, np.float32(behind)).astype(np.float32)


def _seed(height: int, width: int, budget: int) -> NDArray[np.int64]:
    """Flat indices of a coarse grid that holds the corners and at most a quarter of the budget."""
    spacing = max(_SEED_SPACING, int(np.ceil(2 * np.sqrt(height * width / budget))))
    rows = np.linspace(0, height - 1, max(2, 1 + (height - 1) // spacing)).round().astype(np.int64)
    columns = np.linspace(0, width - 1, max(2, 1 + (width - 1) // spacing)).round().astype(np.int64)
    return np.unique(rows[:, None] * width + columns)


def _triangulate(chosen: NDArray[np.int64], width: int) -> tuple[Ints, Ints]:
    vertices = np.stack([chosen % width, chosen // width], axis=1).astype(np.int32)
    return vertices, np.ascontiguousarray(Delaunay(vertices).simplices, np.int32)


def _propose(level: FloatImage, vertices: Ints, triangles: Ints, tolerance: float, room: int) -> NDArray[np.int64]:
    """Flat indices of the worst pixels of the `room` triangles that are wrong about most."""
    worst, total = np.empty((len(triangles), 2), np.int32), np.empty(len(triangles), np.float32)
    misfit(level, vertices, triangles, tolerance, _CAP, worst, total)
    order = np.argsort(-total, kind="stable")[:room]
    order = order[total[order] > 0]
    return np.unique(worst[order, 1].astype(np.int64) * level.shape[1] + worst[order, 0])
