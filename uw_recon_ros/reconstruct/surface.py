"""The textured surface: Delaunay triangles between chosen pixels, none across a discontinuity (paper section 2.3)."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from uw_recon_ros.reconstruct.depth_filter import plausible_sigma
from uw_recon_ros.reconstruct.gaps import close_gaps
from uw_recon_ros.reconstruct.planes import fit_planes, flat_planes
from uw_recon_ros.reconstruct.rasters import broken_triangles
from uw_recon_ros.reconstruct.triangulation import CloudFrame, points_from_depth
from uw_recon_ros.reconstruct.vertices import Ints, choose_vertices
from uw_recon_ros.types import ByteImage, DepthMap, FloatImage, Mask, Matrix, Surface

_BAND_SIGMAS = 4.685  # Tukey's constant
_ROUNDING_PX = 1e-3  # a whole pixel, once turned into depth and back, is not exactly whole


def build_surface(
    depth: DepthMap,
    texture: ByteImage,
    *,
    frame: CloudFrame = "optical",
    max_vertices: int,
    tolerance_px: float,
    max_jump_px: float,
    max_gap_px: int,
    max_obliqueness_deg: float,
    min_area_px: int,
) -> Surface:
    """Triangulate a depth map.

    Parameters
    ----------
    depth : DepthMap
    texture : (H, W, 3) uint8
        RGB of the left rectified view.
    frame : {'optical', 'rectified'}
    max_vertices : int
        Budget.
    tolerance_px : float
        Departure of the surface from the depth map that needs no further vertex, px of disparity.
    max_jump_px : float
        Neighbouring pixels whose disparities differ by more do not belong to one surface.
    max_gap_px : int
        Invalid pixels between two sides of one surface that triangles may cover; 0: none.
    max_obliqueness_deg : float
        Largest angle between a triangle's normal and the ray to the camera, beyond what noise explains.
    min_area_px : int
        Pieces that cover fewer pixels are dropped.

    Returns
    -------
    Surface
        Possibly without triangles, where nothing is valid.
    """
    level = _level(depth)
    closed = _closed(depth, level, max_gap_px, max_jump_px)
    filled = np.isfinite(closed) & np.isnan(level)
    pixels, triangles = choose_vertices(level, filled, budget=max_vertices, tolerance=tolerance_px)
    faces = triangles[:, ::-1]
    faces = faces[~_broken(closed, pixels, faces, max_jump_px)]
    points = points_from_depth(depth.depth, depth.geometry, frame)[pixels[:, 1], pixels[:, 0]]
    faces = faces[~_oblique(depth, level, pixels, points, faces, max_obliqueness_deg)]
    faces = faces[_area_of_piece(pixels, faces) >= min_area_px]
    used, faces = _compact(faces, len(pixels))
    return _dress(depth, texture, pixels[used], points[used], faces)


def _level(depth: DepthMap) -> FloatImage:
    """``d + offset`` in px, signed so that near is high."""
    with np.errstate(divide="ignore", invalid="ignore"):
        level: FloatImage = np.float32(abs(depth.geometry.focal_times_baseline)) / depth.depth
    return level


def _closed(depth: DepthMap, level: FloatImage, max_gap_px: int, max_jump_px: float) -> FloatImage:
    """`level` with its small gaps closed."""
    planes, band = flat_planes(level), np.float32(_BAND_SIGMAS) * plausible_sigma(_sigma_px(depth, level))
    for step in (1, 1, 2):
        planes = fit_planes(planes, band, step)
    return close_gaps(replace(planes, value=level), max_gap_px, max_jump_px)


def _sigma_px(depth: DepthMap, level: FloatImage) -> FloatImage:
    sigma: FloatImage = np.square(level) / np.float32(abs(depth.geometry.focal_times_baseline)) * depth.sigma
    return sigma


def _broken(level: FloatImage, pixels: Ints, faces: Ints, max_jump_px: float) -> Mask:
    cut_right, cut_below = np.ones((2, *level.shape), np.bool_)
    limit = np.float32(max_jump_px + _ROUNDING_PX)
    with np.errstate(invalid="ignore"):
        cut_right[:, :-1] = ~(np.abs(np.diff(level, axis=1)) <= limit)  # NaN is a cut too
        cut_below[:-1] = ~(np.abs(np.diff(level, axis=0)) <= limit)
    broken = np.empty(len(faces), np.bool_)
    broken_triangles(cut_right, cut_below, pixels, np.ascontiguousarray(faces), broken)
    return broken


def _oblique(
    depth: DepthMap, level: FloatImage, pixels: Ints, points: FloatImage, faces: Ints, limit_deg: float
) -> Mask:
    """Seen more obliquely than the limit, and not by noise alone."""
    corners = points[faces].astype(np.float64)
    normals, centres = _face_normals(corners), corners.mean(axis=1)
    cosine = -np.einsum("ij,ij->i", normals, centres)
    cosine /= np.linalg.norm(normals, axis=1) * np.linalg.norm(centres, axis=1)
    at = pixels[:, 1], pixels[:, 0]
    heights = level[at][faces]
    noise = 3 * np.sqrt(2) * plausible_sigma(_sigma_px(depth, level))[at][faces].max(axis=1)
    oblique: Mask = (cosine < np.cos(np.deg2rad(limit_deg))) & (np.ptp(heights, axis=1) > noise)
    return oblique


def _face_normals(corners: Matrix) -> Matrix:
    """(M, 3), as long as twice the triangle's area."""
    normals: Matrix = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return normals


def _area_of_piece(pixels: Ints, faces: Ints) -> Matrix:
    """Area in the image, px^2, of the connected piece each triangle belongs to."""
    a, b, c = (pixels[faces[:, i]].astype(np.float64) for i in range(3))
    areas = _double_area(a, b, c) / 2
    edges = np.concatenate([faces[:, :2], faces[:, 1:]])
    count = len(pixels)
    graph = coo_array((np.ones(len(edges), np.bool_), (edges[:, 0], edges[:, 1])), shape=(count, count))
    piece = connected_components(graph, directed=False)[1][faces[:, 0]]
    totals: Matrix = np.bincount(piece, weights=areas).astype(np.float64)
    return totals[piece]


def _double_area(a: Matrix, b: Matrix, c: Matrix) -> Matrix:
    area: Matrix = np.abs((b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (c[:, 0] - a[:, 0]) * (b[:, 1] - a[:, 1]))
    return area


def _compact(faces: Ints, count: int) -> tuple[NDArray[np.intp], Ints]:
    """Vertices in use, and the faces renumbered."""
    used = np.unique(faces).astype(np.intp)
    number = np.zeros(count, np.int32)
    number[used] = np.arange(len(used), dtype=np.int32)
    return used, np.ascontiguousarray(number[faces])


def _dress(depth: DepthMap, texture: ByteImage, pixels: Ints, points: FloatImage, faces: Ints) -> Surface:
    """Normals, texture coordinates and colours."""
    height, width = depth.depth.shape
    uv = np.stack([(pixels[:, 0] + 0.5) / width, 1 - (pixels[:, 1] + 0.5) / height], axis=1)
    return Surface(
        vertices=points, faces=faces, normals=_vertex_normals(points, faces), uv=uv.astype(np.float32),
        colors=texture[pixels[:, 1], pixels[:, 0]], texture=texture, metric=depth.geometry.metric,
        stamp_ns=depth.stamp_ns, frame_id=depth.frame_id,
    )  # fmt: skip


def _vertex_normals(points: FloatImage, faces: Ints) -> FloatImage:
    """Mean of the adjoining triangles' normals, weighted by area: it cannot turn away from the camera."""
    by_face = _face_normals(points[faces].astype(np.float64))
    corners = np.stack([np.bincount(faces.ravel(), np.repeat(by_face[:, k], 3), len(points)) for k in range(3)], axis=1)
    length: Matrix = np.linalg.norm(corners, axis=1, keepdims=True)
    normals: FloatImage = (corners / np.maximum(length, np.finfo(np.float64).tiny)).astype(np.float32)
    return normals
