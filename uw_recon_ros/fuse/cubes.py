"""The table of marching cubes, made from the rule and not copied: the same rule on both sides of a face leaves no gap.

Lorensen and Cline (1987); on an ambiguous face the corners inside stay apart.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

#: Corner ``x + 2 y + 4 z``; edges by their first corner and axis.
EDGES = tuple((corner, axis) for axis in range(3) for corner in range(8) if not corner >> axis & 1)
MOST = 5  # triangles a cell


def _faces() -> list[list[int]]:
    """Corners of each face, counter-clockwise seen from outside."""
    faces = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        ring = [0, 1 << u, (1 << u) | (1 << v), 1 << v]
        faces.append(ring[::-1])
        faces.append([corner | 1 << axis for corner in ring])
    return faces


def _edge(a: int, b: int) -> int:
    return EDGES.index((min(a, b), (a ^ b).bit_length() - 1))


def _following(inside: int) -> dict[int, int]:
    """Which crossed edge follows which around the surface: along a face from where inside begins to where it ends."""
    following = {}
    for ring in _faces():
        state = [inside >> corner & 1 for corner in ring]
        for k in range(4):
            if state[k - 1] == 0 and state[k] == 1:
                end = next(k + n for n in range(4) if not state[(k + n + 1) % 4])
                following[_edge(ring[k - 1], ring[k])] = _edge(ring[end % 4], ring[(end + 1) % 4])
    return following


def _loops(following: dict[int, int]) -> list[list[int]]:
    rest, loops = dict(following), []
    while rest:
        loop, at = [], min(rest)
        while at in rest:
            loop.append(at)
            at = rest.pop(at)
        loops.append(loop)
    return loops


def _triangles(inside: int) -> list[tuple[int, int, int]]:
    return [(loop[0], loop[k], loop[k + 1]) for loop in _loops(_following(inside)) for k in range(1, len(loop) - 1)]


def make_table() -> NDArray[np.int8]:
    """(256, 15) edges of the triangles for each set of corners inside, -1 past the last."""
    table = np.full((256, 3 * MOST), -1, np.int8)
    for inside in range(256):
        edges = [edge for triangle in _triangles(inside) for edge in triangle]
        table[inside, : len(edges)] = edges
    return table
