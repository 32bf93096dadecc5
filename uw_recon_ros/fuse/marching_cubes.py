"""The surface out of the voxels: marching cubes (Lorensen and Cline, 1987) on blocks.

The table of the 256 cases is built when this is imported: on every face of a cube the crossings are joined so that
inner corners are kept apart, by the face's own four corners alone. Cubes that share a face agree on it, so the surface
has no holes between them, and none between blocks or tiles.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.fuse.blocks import BLOCK, TILE, Keys, neighbours, unpack
from uw_recon_ros.fuse.integrate import Volume
from uw_recon_ros.jit import kernel
from uw_recon_ros.types import FloatImage, Matrix

#: Twelve edges of a cube: the corner they start at (bits x, y, z) and their axis.
_EDGES = [(corner, axis) for axis in range(3) for corner in range(8) if not corner >> axis & 1]
_SPREAD_SHARE = 0.3  # of a depth's variance is common to all views of a place: the matcher's own, measured
_KEY_BITS = 20


def _face_cycles() -> list[list[int]]:
    """Corners of each face, counter-clockwise seen from outside."""
    cycles = []
    for axis in range(3):
        one, two = 1 << (axis + 1) % 3, 1 << (axis + 2) % 3
        cycle = [0, one, one | two, two]
        cycles.append(cycle[::-1])
        cycles.append([corner | 1 << axis for corner in cycle])
    return cycles


def _edge_between(a: int, b: int) -> int:
    return _EDGES.index((min(a, b), (a ^ b).bit_length() - 1))


def _joints(inside: list[bool]) -> dict[int, int]:
    """On each face, from the edge where the cycle enters an inner stretch to the one where it leaves it."""
    follows = {}
    for cycle in _face_cycles():
        flags = [inside[corner] for corner in cycle]
        for k in range(4):
            if not flags[k - 1] and flags[k]:
                end = next(n for n in range(k, k + 4) if flags[n % 4] and not flags[(n + 1) % 4])
                follows[_edge_between(cycle[k - 1], cycle[k])] = _edge_between(cycle[end % 4], cycle[(end + 1) % 4])
    return follows


def _case(number: int) -> list[int]:
    """Edges of the triangles of a case, three each, counter-clockwise seen from outside the surface."""
    follows = _joints([bool(number >> corner & 1) for corner in range(8)])
    triangles = []
    while follows:
        loop = [min(follows)]
        while loop[-1] in follows:
            loop.append(follows.pop(loop[-1]))
        triangles += _fan(loop[:-1])
    return triangles


def _fan(loop: list[int]) -> list[int]:
    """Triangles of a loop, from a corner that no diagonal leaves within a face: the neighbour may have the same one."""
    turned = [loop[k:] + loop[:k] for k in range(len(loop))]
    a, *rest = next(t for t in turned if not any(_share_a_face(t[0], edge) for edge in t[2:-1]))
    return [edge for b, c in pairwise(rest) for edge in (a, b, c)]


def _share_a_face(a: int, b: int) -> bool:
    """Whether two edges lie on one face."""
    corners = {end for start, axis in (_EDGES[a], _EDGES[b]) for end in (start, start | 1 << axis)}
    return any(len({corner >> axis & 1 for corner in corners}) == 1 for axis in range(3))


def _table() -> NDArray[np.int8]:
    """(256, 1 + 3 n): number of triangles, then their edges; bit c of a case says that corner c is inside."""
    cases = [_case(number) for number in range(256)]
    table = np.zeros((256, 1 + max(map(len, cases))), np.int8)
    for number, edges in enumerate(cases):
        table[number, 0] = len(edges) // 3
        table[number, 1 : 1 + len(edges)] = edges
    return table


TABLE = _table()
_STARTS = np.array([corner for corner, _ in _EDGES], np.int64)
_AXES = np.array([axis for _, axis in _EDGES], np.int64)


@dataclass(frozen=True, eq=False)
class Patch:
    """A piece of surface.

    Parameters
    ----------
    vertices : (N, 3) float64
        World, m.
    faces : (M, 3) int32
        Counter-clockwise seen from outside.
    sigma : (N,) float32
        Standard deviation along the normal, m.
    views : (N,) int32
        Depth maps that saw it.
    keys : (N,) int64
        Names of the voxels' edges that the vertices lie on, the same in all pieces.
    """

    vertices: Matrix
    faces: NDArray[np.int32]
    sigma: FloatImage
    views: NDArray[np.int32]
    keys: Keys


@kernel
def _cell(
    volume: FloatImage, weight: FloatImage, around: NDArray[np.int32], b: int, x: int, y: int, z: int,
    where: NDArray[np.int64],
) -> int:  # fmt: skip
    """Case of a cell, 0 where a corner was never seen; `where` (8, 2) gets its corners' blocks and indices."""
    case = 0
    for corner in range(8):
        i, j, k = x + (corner & 1), y + (corner >> 1 & 1), z + (corner >> 2)
        block = around[b, (i >> 3) | (j >> 3) << 1 | (k >> 3) << 2]
        index = 64 * (i & 7) + 8 * (j & 7) + (k & 7)
        if block < 0 or weight[block, index] <= 0.0:
            return 0
        where[corner, 0], where[corner, 1] = block, index
        case |= (volume[block, index] < 0.0) << corner
    return case


@kernel
def _count(
    distance: FloatImage, weight: FloatImage, around: NDArray[np.int32], own: NDArray[np.bool_],
    table: NDArray[np.int8],
) -> int:  # fmt: skip
    """Triangles of the cells of own blocks."""
    where = np.empty((8, 2), np.int64)
    total = 0
    for b in range(len(own)):
        if own[b]:
            for cell in range(512):
                case = _cell(distance, weight, around, b, cell >> 6, cell >> 3 & 7, cell & 7, where)
                total += table[case, 0]
    return total


@kernel
def _fill(
    distance: FloatImage, weight: FloatImage, around: NDArray[np.int32], own: NDArray[np.bool_],
    table: NDArray[np.int8], starts: NDArray[np.int64], axes: NDArray[np.int64],
    numbers: NDArray[np.int32], faces: NDArray[np.int32], ends: NDArray[np.int64],
) -> int:  # fmt: skip
    """Triangles, and for every vertex the voxels it lies between and its axis (block, index, block, index, axis)."""
    where = np.empty((8, 2), np.int64)
    triangles = vertices = 0
    for b in range(len(own)):
        if not own[b]:
            continue
        for cell in range(512):
            case = _cell(distance, weight, around, b, cell >> 6, cell >> 3 & 7, cell & 7, where)
            for n in range(3 * table[case, 0]):
                edge = table[case, 1 + n]
                start, axis = starts[edge], axes[edge]
                block, index = where[start, 0], where[start, 1]
                number = numbers[block, 3 * index + axis]
                if number < 0:
                    number = vertices
                    numbers[block, 3 * index + axis] = number
                    ends[number, 0], ends[number, 1] = block, index
                    ends[number, 2], ends[number, 3] = where[start | 1 << axis, 0], where[start | 1 << axis, 1]
                    ends[number, 4] = axis
                    vertices += 1
                faces[triangles + n // 3, n % 3] = number
            triangles += table[case, 0]
    return vertices


def extract(volume: Volume, tile: Keys | None = None) -> Patch:
    """The surface where the distance changes its sign between voxels that were seen.

    Parameters
    ----------
    volume : Volume
    tile : (3,) int64, optional
        Only cells that begin in this tile's own blocks; None: all.
    """
    own = np.ones(len(volume.keys), np.bool_)
    if tile is not None:
        own = (np.floor_divide(unpack(volume.keys), TILE) == tile).all(axis=1)
    around = neighbours(volume.keys)
    count = _count(volume.distance, volume.weight, around, own, TABLE)
    numbers = np.full((len(own), 3 * BLOCK**3), -1, np.int32)
    faces, ends = np.empty((count, 3), np.int32), np.empty((3 * count, 5), np.int64)
    made = _fill(
        volume.distance, volume.weight, around, own, TABLE, _STARTS, _AXES, numbers, faces, ends
    )  # fmt: skip
    return _patch(volume, faces, ends[:made])


def _places(volume: Volume, block: Keys, index: Keys) -> Keys:
    """(N, 3) voxel coordinates in the world."""
    return unpack(volume.keys)[block] * BLOCK + np.stack([index >> 6, index >> 3 & 7, index & 7], axis=1)


def _patch(volume: Volume, faces: NDArray[np.int32], ends: Keys) -> Patch:
    first, second = (ends[:, 0], ends[:, 1]), (ends[:, 2], ends[:, 3])
    a, b = volume.distance[first].astype(np.float64), volume.distance[second].astype(np.float64)
    share = a / (a - b) if len(a) else a
    start = _places(volume, *first)
    vertices = start * volume.voxel
    vertices[np.arange(len(start)), ends[:, 4]] += share * volume.voxel
    sigmas = [_sigma(volume, end) for end in (first, second)]
    nearer = share < 0.5
    sigma = ((1 - share) * sigmas[0] + share * sigmas[1]).astype(np.float32)
    views = np.where(nearer, volume.views[first], volume.views[second]).astype(np.int32)
    shifted = start + (1 << _KEY_BITS - 1)
    keys = (shifted[:, 0] << 2 * _KEY_BITS | shifted[:, 1] << _KEY_BITS | shifted[:, 2]) << 2 | ends[:, 4]
    return Patch(np.asarray(vertices, np.float64), faces, sigma, views, keys)


def _sigma(volume: Volume, end: tuple[Keys, Keys]) -> Matrix:
    """Of the surface near a voxel, m: what views have in common does not average out; where they disagree, it grows."""
    weight, distance = (x[end].astype(np.float64) for x in (volume.weight, volume.distance))
    views = np.maximum(volume.views[end].astype(np.float64), 1.0)
    surprise = np.maximum(volume.square[end] - weight * distance**2, 0.0) / views  # chi square a view
    share = _SPREAD_SHARE * views + 1 - _SPREAD_SHARE
    return np.asarray(np.sqrt(share / weight * np.maximum(surprise, 1.0)), np.float64)


def joined(patches: list[Patch]) -> Patch:
    """Pieces as one, vertices on common edges merged; in the order given."""
    offsets = np.cumsum([0, *(len(patch.vertices) for patch in patches)])
    keys = np.concatenate([patch.keys for patch in patches] or [np.empty(0, np.int64)])
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    faces = [patch.faces + start for patch, start in zip(patches, offsets, strict=False)]
    stacked = np.concatenate(faces) if faces else np.empty((0, 3), np.int64)
    return Patch(
        _stack([p.vertices for p in patches], (0, 3))[first].astype(np.float64),
        inverse.reshape(-1)[stacked].astype(np.int32),
        _stack([p.sigma for p in patches], (0,))[first].astype(np.float32),
        _stack([p.views for p in patches], (0,))[first].astype(np.int32), keys[first],
    )  # fmt: skip


def _stack(parts: list[NDArray[np.generic]], shape: tuple[int, ...]) -> NDArray[np.generic]:
    return np.concatenate(parts) if parts else np.empty(shape)
