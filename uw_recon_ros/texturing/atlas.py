"""A texture's place for every triangle: charts that look along one axis, packed side by side in a square.

A bottom is mostly seen from above, so charts are made as simply as that: a triangle is projected along the axis its
normal is nearest to, upwards wherever that stretches it by no more than a factor of two; charts are cut where the axis
changes and along a grid, which makes most of them squares that pack well.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from uw_recon_ros.jit import kernel
from uw_recon_ros.texturing.simplify import Faces
from uw_recon_ros.types import ByteImage, FloatImage, Matrix

_UPRIGHT = 0.5  # cosine from which a triangle is drawn as seen from above or below
_CHARTS_ACROSS = 16  # squares along the side of a flat square surface
_MARGIN_PX = 2  # about each chart
_LEAST_CHART = 40.0  # texels, of which margins take a fifth
_LEAST_PX = 16
_BAND = 256  # rows
_ACROSS = np.array([[1, 2], [2, 0], [0, 1]])  # axes of a picture that looks along x, y, z


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
    """Cut a mesh into charts.

    Parameters
    ----------
    vertices : (N, 3) float64
        m.
    faces : (M, 3) int32
    texel : float
        Edge of a texel wanted, m.
    most_px : int
        Side of the texture at most, if the margins of all charts have room in it; texels grow until it is enough.
    """
    while True:
        source, found, flat, chart = _charts(vertices, faces, _LEAST_CHART * texel)
        low, high = _bounds(flat, chart)
        boxes = np.ceil((high - low) / texel).astype(np.int64) + 1 + 2 * _MARGIN_PX
        corners, size = _packed(boxes)
        if size <= most_px or (boxes == 2 + 2 * _MARGIN_PX).all():
            break
        texel *= max(size / most_px, 1.02)
    pixels = (flat - low[chart]) / texel + corners[chart] + _MARGIN_PX
    return Atlas(vertices[source], found, ((pixels + 0.5) / size).astype(np.float32), size)


def _charts(vertices: Matrix, faces: Faces, least: float) -> tuple[NDArray[np.int64], Faces, Matrix, NDArray[np.int64]]:
    """Vertices doubled along cuts: which (N,) they were, faces (M, 3), flattened (N, 2) m, chart (N,).

    `least` is the grid's step at least, m.
    """
    a, b, c = np.moveaxis(vertices[faces], 1, 0)
    normals = np.cross(b - a, c - a)
    area = np.linalg.norm(normals, axis=1)
    sideways = np.abs(normals)
    sideways[sideways[:, 2] >= _UPRIGHT * area, 2] = np.inf
    axis = sideways.argmax(axis=1)
    behind = normals[np.arange(len(faces)), axis] < 0
    cell = max(math.sqrt(area.sum() / 2) / _CHARTS_ACROSS, least)
    middle = np.take_along_axis((a + b + c) / 3, _ACROSS[axis], axis=1)
    square = np.column_stack([axis, behind, np.floor(middle / cell)]).astype(np.int64)
    square = np.unique(square, axis=0, return_inverse=True)[1].reshape(-1)
    names, corner = np.unique((square[:, None] * len(vertices) + faces).ravel(), return_inverse=True)
    found = corner.reshape(-1, 3).astype(np.int32)
    joints = np.ones(2 * len(found), np.int8), (found[:, :2].ravel(), found[:, 1:].ravel())
    chart = connected_components(coo_matrix(joints, 2 * (len(names),)), directed=False)[1].astype(np.int64)
    looks = np.empty(len(names), np.int64)
    looks[found.ravel()] = np.repeat(axis, 3)
    source = names % len(vertices)
    return source, found, np.take_along_axis(vertices[source], _ACROSS[looks], axis=1), chart


def _bounds(flat: Matrix, chart: NDArray[np.int64]) -> tuple[Matrix, Matrix]:
    """(C, 2) least and greatest coordinates of each chart, m."""
    low, high = np.full((chart.max() + 1, 2), np.inf), np.full((chart.max() + 1, 2), -np.inf)
    np.minimum.at(low, chart, flat)
    np.maximum.at(high, chart, flat)
    return low, high


def _packed(boxes: NDArray[np.int64]) -> tuple[NDArray[np.int64], int]:
    """Boxes (C, 2) px, the highest first, on shelves in a square: upper left corners (C, 2), and its side."""
    order = np.lexsort((-boxes[:, 0], -boxes[:, 1]))
    size = max(_LEAST_PX, int(boxes.max()), math.ceil(math.sqrt(float(boxes.prod(axis=1).sum()))))
    while True:
        corners, height = _shelved(boxes, order, size)
        if height <= size:
            return corners, size
        size += max(1, (height - size) // 4)


def _shelved(boxes: NDArray[np.int64], order: NDArray[np.intp], width: int) -> tuple[NDArray[np.int64], int]:
    corners, x, y, shelf = np.zeros_like(boxes), 0, 0, 0
    for k in order.tolist():
        across, down = boxes[k]
        if x + across > width:
            x, y, shelf = 0, y + shelf, 0
        corners[k] = x, y
        x, shelf = x + across, max(shelf, down)
    return corners, int(y + shelf)


@kernel(allocates=False)
def _draw_charts(
    vertices: Matrix, normals: FloatImage, faces: Faces, uv: FloatImage, size: int, filled: NDArray[np.bool_],
    where: NDArray[np.int64], places: Matrix, directions: FloatImage,
) -> int:  # fmt: skip
    """Index, place and normal of the texels that charts cover, each once; how many there are, written or not."""
    count = 0
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
                if one < -1e-6 or two < -1e-6 or three < -1e-6 or filled[row, column]:
                    continue
                filled[row, column] = True
                if count < len(where):
                    where[count] = row * size + column
                    for k in range(3):
                        places[count, k] = one * vertices[a, k] + two * vertices[b, k] + three * vertices[c, k]
                        directions[count, k] = one * normals[a, k] + two * normals[b, k] + three * normals[c, k]
                count += 1
    return count


@dataclass(frozen=True, eq=False)
class Texels:
    """Texels that charts cover.

    Parameters
    ----------
    index : (N,) int64
        Row times the texture's side plus column.
    points : (N, 3) float64
        m.
    normals : (N, 3) float32
    """

    index: NDArray[np.int64]
    points: Matrix
    normals: FloatImage


def texels_of(atlas: Atlas, normals: FloatImage, faces: Faces) -> Texels:
    """Where on the surface the texels of some of the faces lie.

    Parameters
    ----------
    atlas : Atlas
    normals : (N, 3) float32
        Of its vertices.
    faces : (M, 3) int32
        Of the atlas.
    """
    fixed = atlas.vertices, normals, np.ascontiguousarray(faces), atlas.uv, atlas.size
    side = atlas.size, atlas.size
    none = np.empty(0, np.int64), np.empty((0, 3)), np.empty((0, 3), np.float32)
    count = _draw_charts(*fixed, np.zeros(side, np.bool_), *none)
    found = Texels(np.empty(count, np.int64), np.empty((count, 3)), np.empty((count, 3), np.float32))
    _draw_charts(*fixed, np.zeros(side, np.bool_), found.index, found.points, found.normals)
    return found


def grown(image: ByteImage, filled: NDArray[np.bool_], rounds: int = 6) -> ByteImage:
    """The image (H, W, 3) with what is filled grown outwards, so that no viewer mixes a chart with its background."""
    made = np.empty_like(image)
    for first in range(0, len(image), _BAND):  # in floats, a whole texture takes too much memory
        start = max(first - rounds, 0)
        part = slice(start, first + _BAND + rounds)
        made[first : first + _BAND] = _grown(image[part], filled[part], rounds)[first - start :][:_BAND]
    return made


def _grown(part: ByteImage, filled: NDArray[np.bool_], rounds: int) -> ByteImage:
    image, weight = part.astype(np.float32), filled.astype(np.float32)
    for _ in range(rounds):
        total = cv2.blur(image * weight[..., None], (3, 3))
        count = cv2.blur(weight, (3, 3))
        new = (weight == 0) & (count > 0)
        image[new] = total[new] / count[new, None]
        weight[new] = 1.0
    return np.rint(image).astype(np.uint8)
