"""The surface out of a volume: marching cubes block by block, vertices named by place so that blocks and tiles join."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from uw_recon_ros.fuse.blocks import SIDE, keys_of
from uw_recon_ros.fuse.cubes import EDGES, MOST, make_table
from uw_recon_ros.fuse.volume import Volume
from uw_recon_ros.jit import kernel
from uw_recon_ros.types import ByteImage, FloatImage, Matrix

_TABLE = make_table()
_EDGES = np.array(EDGES, np.int64)
Ints = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class FusedMesh:
    """A surface, and how sure it is.

    Parameters
    ----------
    vertices : (N, 3) float64
        m, in the world less its origin.
    faces : (M, 3) int32
        Counter-clockwise seen from the cameras.
    colors : (N, 3) uint8
        RGB, mean of the views by weight.
    sigma : (N,) float32
        Of one view at that place, along its ray, m: errors of neighbouring views are alike, so more views do not
        make it smaller.
    views : (N,) uint16
        How many saw it.
    keys : (N,) int64
        Names of the grid edges the vertices lie on.
    """

    vertices: Matrix
    faces: NDArray[np.int32]
    colors: ByteImage
    sigma: FloatImage
    views: NDArray[np.uint16]
    keys: Ints


def extract(volume: Volume, owned: NDArray[np.bool_], min_views: int = 1) -> FusedMesh:
    """The surface in the cells of blocks `owned` (N,); the others lend their voxels.

    Parameters
    ----------
    volume : Volume
    owned : (N,) bool
    min_views : int
        Triangles at a vertex that fewer views saw are left out.
    """
    neighbours = _neighbours(volume)
    seen = volume.weight > 0
    cells = np.flatnonzero(owned).astype(np.int64)
    counts = np.zeros(len(cells), np.int64)
    nothing = np.zeros((0, 2), np.int64)
    _march(cells, neighbours, volume.distance, seen, _TABLE, _EDGES, counts, nothing, np.zeros(0, np.int64))
    starts = np.r_[0, np.cumsum(counts)]
    ends, axes = np.empty((starts[-1], 2), np.int64), np.empty(starts[-1], np.int64)
    _march(cells, neighbours, volume.distance, seen, _TABLE, _EDGES, starts[:-1].copy(), ends, axes)
    mesh = _mesh(volume, ends, axes)
    return replace(mesh, faces=mesh.faces[(mesh.views[mesh.faces] >= min_views).all(axis=1)])


def _neighbours(volume: Volume) -> Ints:
    """(N, 8) slots of each block and those at +1 along x (bit 0), y, z; -1 = not there."""
    found = np.empty((len(volume.keys), 8), np.int64)
    for corner in range(8):
        wanted = keys_of(volume.coordinates + np.array([corner >> axis & 1 for axis in range(3)], np.int64))
        at = np.searchsorted(volume.keys, wanted).clip(0, max(len(volume.keys) - 1, 0))
        found[:, corner] = np.where(volume.keys[at] == wanted, at, -1) if len(volume.keys) else at
    return found


@kernel
def _march(
    cells: Ints, neighbours: Ints, distance: FloatImage, seen: NDArray[np.bool_], table: NDArray[np.int8],
    edges: Ints, counts: Ints, ends: Ints, axes: Ints,
) -> None:  # fmt: skip
    """Without room in `ends`, count the triangles' corners of each block; with it, write both ends of their edges."""
    where, write = np.empty(8, np.int64), len(ends) > 0
    for i in range(len(cells)):
        for k in range(SIDE * SIDE * SIDE):
            x, y, z = k % SIDE, k // SIDE % SIDE, k // (SIDE * SIDE)
            inside, whole = 0, True
            for c in range(8):
                cx, cy, cz = x + (c & 1), y + (c >> 1 & 1), z + (c >> 2)
                slot = neighbours[cells[i], cx // SIDE + 2 * (cy // SIDE) + 4 * (cz // SIDE)]
                local = (cz % SIDE * SIDE + cy % SIDE) * SIDE + cx % SIDE
                if slot < 0 or not seen[slot, local]:
                    whole = False
                    break
                where[c] = slot * SIDE * SIDE * SIDE + local
                if distance[slot, local] < 0.0:
                    inside |= 1 << c
            if not whole:
                continue
            for m in range(3 * MOST):
                edge = table[inside, m]
                if edge < 0:
                    break
                if write:
                    ends[counts[i], 0] = where[edges[edge, 0]]
                    ends[counts[i], 1] = where[edges[edge, 0] | 1 << edges[edge, 1]]
                    axes[counts[i]] = edges[edge, 1]
                counts[i] += 1


def _places(volume: Volume, flat: Ints) -> Ints:
    """(N, 3) whole voxel coordinates of flat indices."""
    local = flat % SIDE**3
    inner = np.stack([local % SIDE, local // SIDE % SIDE, local // SIDE**2], axis=1)
    return volume.coordinates[flat // SIDE**3] * SIDE + inner


def _mesh(volume: Volume, ends: Ints, axes: Ints) -> FusedMesh:
    places = _places(volume, ends[:, 0])
    keys, first, corners = np.unique(keys_of(places) * 3 + axes, return_index=True, return_inverse=True)
    a, b = ends[first, 0], ends[first, 1]
    da, db = (volume.distance.ravel()[x].astype(np.float64) for x in (a, b))
    share = da / np.where(da == db, 1.0, da - db)
    vertices = places[first].astype(np.float64)
    vertices[np.arange(len(first)), axes[first]] += share
    near = _mixed(volume.near.reshape(-1, 1), a, b, share)
    views = np.maximum(volume.views.ravel()[a], volume.views.ravel()[b])
    colors = _mixed(volume.color.reshape(-1, 3), a, b, share) / np.maximum(near, 1e-12)
    sigma = np.sqrt(views / np.maximum(near[:, 0], 1e-12))
    faces = corners.reshape(-1, 3).astype(np.int32)
    return FusedMesh(
        vertices * volume.voxel_m, faces, np.rint(colors).clip(0, 255).astype(np.uint8), sigma.astype(np.float32),
        views, keys,
    )  # fmt: skip


def _mixed(values: FloatImage, a: Ints, b: Ints, share: Matrix) -> Matrix:
    mixed: Matrix = values[a] * (1 - share)[:, None] + values[b] * share[:, None]
    return mixed


def joined(parts: Sequence[FusedMesh]) -> FusedMesh:
    """One mesh of several, vertices of one name being one."""
    keys, first, corner = np.unique(np.concatenate([p.keys for p in parts]), return_index=True, return_inverse=True)
    starts = np.cumsum([0, *(len(p.keys) for p in parts)])
    faces = np.concatenate([corner[p.faces + start] for p, start in zip(parts, starts[:-1], strict=True)])
    rows = [np.concatenate([getattr(p, name) for p in parts])[first] for name in ("vertices", "colors", "sigma",
                                                                                   "views")]  # fmt: skip
    return FusedMesh(rows[0], _whole(faces), rows[1], rows[2], rows[3], keys)


def _whole(faces: Ints) -> NDArray[np.int32]:
    """Without triangles that two equal corners make a line."""
    a, b, c = faces.T
    return np.asarray(faces[(a != b) & (b != c) & (a != c)], np.int32)


def without_islands(mesh: FusedMesh, least: int) -> FusedMesh:
    """Without connected parts of fewer than `least` triangles, and without vertices that no triangle has."""
    if not len(mesh.faces):
        return mesh
    n = len(mesh.vertices)
    a, b = mesh.faces[:, [0, 1]].T, mesh.faces[:, [1, 2]].T
    rows, columns = np.concatenate([a[0], b[0]]), np.concatenate([a[1], b[1]])
    _, part = connected_components(coo_matrix((np.ones(len(rows), np.int8), (rows, columns)), shape=(n, n)), False)
    counts = np.bincount(part[mesh.faces[:, 0]], minlength=part.max() + 1)
    faces = mesh.faces[counts[part[mesh.faces[:, 0]]] >= least]
    used = np.unique(faces)
    number = np.full(n, -1, np.int32)
    number[used] = np.arange(len(used), dtype=np.int32)
    return FusedMesh(mesh.vertices[used], number[faces], mesh.colors[used], mesh.sigma[used], mesh.views[used],
                     mesh.keys[used])  # fmt: skip
