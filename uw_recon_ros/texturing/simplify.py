"""Fewer triangles, and a texture for them: quadric simplification and an atlas of charts, both by known libraries."""

from __future__ import annotations

from dataclasses import dataclass
from importlib.util import find_spec

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.types import ByteImage, FloatImage, Matrix

Faces = NDArray[np.int32]
_EXTRA = ("fast_simplification", "xatlas")


def has_extra() -> bool:
    """Whether the libraries of the extra ``model`` are installed."""
    return all(find_spec(name) is not None for name in _EXTRA)


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


@dataclass(frozen=True, eq=False)
class Atlas:
    """A mesh cut into charts that lie side by side in a square.

    Parameters
    ----------
    vertices : (N, 3) float64
        Those on cuts several times.
    faces : (M, 3) int32
    uv : (N, 2) float32
        0 to 1, origin at the upper left.
    size : int
        Of the texture, px.
    """

    vertices: Matrix
    faces: Faces
    uv: FloatImage
    size: int


def make_atlas(vertices: Matrix, faces: Faces, texel: float, most_px: int) -> Atlas:
    """Cut a mesh into charts; needs `has_extra`.

    Parameters
    ----------
    vertices : (N, 3) float64
        m.
    faces : (M, 3) int32
    texel : float
        Edge of a texel wanted, m.
    most_px : int
        Side of the texture at most; texels grow until it is enough.
    """
    import xatlas

    middle = vertices.mean(axis=0)
    mapping, found, uv = xatlas.parametrize((vertices - middle).astype(np.float32), faces.astype(np.uint32))
    kept = vertices[mapping]
    size = _texture_size(kept, found, uv, texel, most_px)
    return Atlas(kept, found.astype(np.int32), uv.astype(np.float32), size)


def _texture_size(vertices: Matrix, faces: NDArray[np.uint32], uv: FloatImage, texel: float, most_px: int) -> int:
    """Side of a square whose texels are as large as wanted."""
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    p, q, r = np.moveaxis(uv[faces].astype(np.float64), 1, 0)
    share = np.abs((q - p)[:, 0] * (r - p)[:, 1] - (q - p)[:, 1] * (r - p)[:, 0]).sum() / 2
    wanted = np.sqrt(area / max(share, 1e-6)) / texel
    return int(min(most_px, max(16, 4 * np.ceil(wanted / 4))))


@kernel(allocates=False)
def _draw_charts(
    vertices: Matrix, normals: FloatImage, faces: Faces, uv: FloatImage, size: int, places: Matrix,
    directions: FloatImage, filled: NDArray[np.bool_],
) -> None:  # fmt: skip
    """Places and normals of the texels that charts cover."""
    for f in range(len(faces)):
        a, b, c = faces[f, 0], faces[f, 1], faces[f, 2]
        ax, ay, bx, by = uv[a, 0] * size - 0.5, uv[a, 1] * size - 0.5, uv[b, 0] * size - 0.5, uv[b, 1] * size - 0.5
        cx, cy = uv[c, 0] * size - 0.5, uv[c, 1] * size - 0.5
        area = (bx - ax) * (cy - ay) - (cx - ax) * (by - ay)
        if abs(area) < 1e-12:
            continue
        for row in range(max(int(min(ay, min(by, cy))), 0), min(int(max(ay, max(by, cy))) + 2, size)):
            for column in range(max(int(min(ax, min(bx, cx))), 0), min(int(max(ax, max(bx, cx))) + 2, size)):
                one = ((bx - column) * (cy - row) - (cx - column) * (by - row)) / area
                two = ((cx - column) * (ay - row) - (ax - column) * (cy - row)) / area
                three = 1.0 - one - two
                if one < -1e-6 or two < -1e-6 or three < -1e-6:
                    continue
                filled[row, column] = True
                for k in range(3):
                    places[row, column, k] = one * vertices[a, k] + two * vertices[b, k] + three * vertices[c, k]
                    directions[row, column, k] = one * normals[a, k] + two * normals[b, k] + three * normals[c, k]


@dataclass(frozen=True, eq=False)
class Texels:
    """Places of the texels that charts cover: `filled` (size, size), `points` (N, 3) and `normals` (N, 3) of those."""

    filled: NDArray[np.bool_]
    points: Matrix
    normals: FloatImage


def texels_of(atlas: Atlas) -> Texels:
    """Where on the surface each texel lies."""
    places, normals = np.zeros((atlas.size, atlas.size, 3)), np.zeros((atlas.size, atlas.size, 3), np.float32)
    filled = np.zeros((atlas.size, atlas.size), np.bool_)
    own = vertex_normals(atlas.vertices, atlas.faces)
    _draw_charts(atlas.vertices, own, atlas.faces, atlas.uv, atlas.size, places, normals, filled)
    return Texels(filled, places[filled], normals[filled])


def grown(image: ByteImage, filled: NDArray[np.bool_], rounds: int = 6) -> ByteImage:
    """The image (H, W, 3) with what is filled grown outwards, so that no viewer mixes a chart with its background."""
    image, weight = image.astype(np.float32), filled.astype(np.float32)
    for _ in range(rounds):
        total = cv2.blur(image * weight[..., None], (3, 3))
        count = cv2.blur(weight, (3, 3))
        new = (weight == 0) & (count > 0)
        image[new] = total[new] / count[new, None]
        weight[new] = 1.0
    return np.rint(image).astype(np.uint8)
