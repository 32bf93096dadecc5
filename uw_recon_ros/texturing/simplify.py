"""Fewer triangles of nearly the same shape."""

from __future__ import annotations

from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.types import FloatImage, Matrix

Faces = NDArray[np.int32]


def has_extra() -> bool:
    """Whether the library of the extra ``model`` is installed."""
    return find_spec("fast_simplification") is not None


def simplified(vertices: Matrix, faces: Faces, count: int) -> tuple[Matrix, Faces]:
    """About `count` triangles of nearly the same shape (Garland and Heckbert, 1997); needs `has_extra`."""
    import fast_simplification

    if len(faces) <= count:
        return vertices, faces
    middle = vertices.mean(axis=0)
    points, kept = fast_simplification.simplify((vertices - middle).astype(np.float32), faces, target_count=count)
    return _tidied(points.astype(np.float64) + middle, kept.astype(np.int32))


def clustered(vertices: Matrix, faces: Faces, count: int) -> tuple[NDArray[np.intp], Faces]:
    """About `count` triangles, roughly: vertices in one cell become the first of them; needs no extra.

    Returns
    -------
    (N,) indices of the vertices that stay, (M, 3) int32 triangles of those
    """
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    area = float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2)
    edge = max(np.sqrt(2 * area / max(count, 1)), 1e-9)
    cells = np.floor((vertices - vertices.min(axis=0)) / edge).astype(np.int64)
    _, first, owner = np.unique(cells, axis=0, return_index=True, return_inverse=True)
    joined = owner.reshape(-1)[faces]
    flat = (joined[:, 0] == joined[:, 1]) | (joined[:, 1] == joined[:, 2]) | (joined[:, 2] == joined[:, 0])
    return first, joined[~flat].astype(np.int32)


def _tidied(vertices: Matrix, faces: Faces) -> tuple[Matrix, Faces]:
    """Without triangles of no area and vertices that none uses."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    faces = faces[np.linalg.norm(np.cross(b - a, c - a), axis=1) > 0]
    used, inverse = np.unique(faces, return_inverse=True)
    return vertices[used], inverse.reshape(-1, 3).astype(np.int32)


def vertex_normals(vertices: Matrix, faces: Faces) -> FloatImage:
    """(N, 3) outward unit normals, triangles weighted by their area."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    across = np.cross(b - a, c - a)
    total = np.stack([np.bincount(faces.T.ravel(), np.tile(across[:, k], 3), len(vertices)) for k in range(3)], axis=1)
    length = np.linalg.norm(total, axis=1, keepdims=True)
    return np.where(length > 0, total / np.maximum(length, 1e-30), [0.0, 0.0, 1.0]).astype(np.float32)
