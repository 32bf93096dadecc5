"""Where rays meet a scene: exact to well below a pixel, occlusion included.

Every kernel takes the scene as its arrays (`heights`, `grid`, `blocks`, `objects` of `Scene`), rays as an origin and a
unit direction in world coordinates, and gives distances along the ray in m; infinity where nothing is met.
"""

from __future__ import annotations

import math

import numpy as np

from uw_recon_ros.jit import kernel
from uw_recon_ros.simulate.seabed import hit_seabed
from uw_recon_ros.simulate.solids import NEAREST_M, hit_thing
from uw_recon_ros.types import Matrix

FAR_M = 25.0


@kernel
def nearest_thing(
    objects: Matrix, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, limit: float
) -> tuple[float, int, float, float, float]:
    """Distance, index (-2 nothing) and world normal of the thing a ray meets first."""
    best, which = limit, -2
    nx = ny = nz = 0.0
    for index in range(objects.shape[0]):
        o = objects[index]
        px, py, pz = ox - o[1], oy - o[2], oz - o[3]
        t, a, b, c = hit_thing(
            o,
            o[4] * px + o[5] * py + o[6] * pz, o[7] * px + o[8] * py + o[9] * pz, o[10] * px + o[11] * py + o[12] * pz,
            o[4] * dx + o[5] * dy + o[6] * dz, o[7] * dx + o[8] * dy + o[9] * dz, o[10] * dx + o[11] * dy + o[12] * dz,
            best,
        )  # fmt: skip
        if t < best:
            best, which = t, index
            nx = o[4] * a + o[7] * b + o[10] * c
            ny = o[5] * a + o[8] * b + o[11] * c
            nz = o[6] * a + o[9] * b + o[12] * c
    return best, which, nx, ny, nz


@kernel
def nearest_hit(
    heights: Matrix, grid: Matrix, blocks: Matrix, objects: Matrix,
    ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, limit: float,
) -> tuple[float, int, float, float, float]:  # fmt: skip
    """Distance, index of the thing (-1 the seabed, -2 nothing) and world normal of what a ray meets first."""
    best, which, nx, ny, nz = nearest_thing(objects, ox, oy, oz, dx, dy, dz, limit)
    t, a, b, c = hit_seabed(heights, grid, blocks, ox, oy, oz, dx, dy, dz, NEAREST_M, best)
    if t < best:
        return t, -1, a, b, c
    if which == -2:
        return math.inf, which, 0.0, 0.0, 0.0
    return best, which, nx, ny, nz


@kernel
def is_blocked(
    heights: Matrix, grid: Matrix, blocks: Matrix, objects: Matrix,
    ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, limit: float,
) -> bool:  # fmt: skip
    """Whether anything is met before the limit; the seabed's own bumps count from 2 cm on."""
    if hit_seabed(heights, grid, blocks, ox, oy, oz, dx, dy, dz, 0.02, limit)[0] < limit:
        return True
    return nearest_thing(objects, ox, oy, oz, dx, dy, dz, limit)[1] >= 0


@kernel
def cast(
    heights: Matrix, grid: Matrix, blocks: Matrix, objects: Matrix, origin: Matrix, directions: Matrix, limits: Matrix
) -> Matrix:
    """Distance along each ray.

    Parameters
    ----------
    origin : (3,) float64
        m.
    directions : (N, 3) float64
        Unit vectors.
    limits : (N,) float64
        How far to look, m.

    Returns
    -------
    (N,) float64
        m; infinity where nothing is met before the limit.
    """
    ranges = np.empty(directions.shape[0])
    for i in range(directions.shape[0]):
        ranges[i] = nearest_hit(
            heights, grid, blocks, objects, origin[0], origin[1], origin[2],
            directions[i, 0], directions[i, 1], directions[i, 2], limits[i],
        )[0]  # fmt: skip
    return ranges
