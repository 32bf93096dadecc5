"""The whole surface as one mesh with a colour, a sigma and a number of views at every vertex; and as a textured one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from uw_recon_ros.fuse.blocks import Keys
from uw_recon_ros.fuse.marching_cubes import joined
from uw_recon_ros.fuse.surface_pieces import without_loose_pieces
from uw_recon_ros.model.colors import Column, color_points
from uw_recon_ros.model.maps import Overview
from uw_recon_ros.model.surface import Found, column_patch, columns_of
from uw_recon_ros.model.work import TileTask, World
from uw_recon_ros.texturing.atlas import Atlas, grown, make_atlas, texels_of
from uw_recon_ros.texturing.gains import Balance
from uw_recon_ros.texturing.simplify import clustered, has_extra, simplified, vertex_normals
from uw_recon_ros.types import ByteImage, FloatImage, Matrix, Surface

_AT_ONCE = 1_000_000  # triangles that are joined before they are simplified, at 0.4 kB each
_APART_VOXELS = 2.0  # corners farther apart than this err by themselves


@dataclass(frozen=True, eq=False)
class Mesh:
    """Triangles and what is known at their corners.

    Parameters
    ----------
    vertices : (N, 3) float64
        World less the origin, m.
    faces : (M, 3) int32
    colors : (N, 3) uint8
    sigma : (N,) float32
        m.
    views : (N,) int32
    """

    vertices: Matrix
    faces: NDArray[np.int32]
    colors: ByteImage
    sigma: FloatImage
    views: NDArray[np.int32]


def reduced(mesh: Mesh, count: int) -> Mesh:
    """About `count` triangles; what is known at a vertex is that of the nearest one before."""
    if len(mesh.faces) <= count or not has_extra():
        return mesh
    vertices, faces = simplified(mesh.vertices, mesh.faces, count)
    nearest = cKDTree(mesh.vertices).query(vertices)[1]
    return Mesh(vertices, faces, mesh.colors[nearest], mesh.sigma[nearest], mesh.views[nearest])


def stacked(meshes: list[Mesh]) -> Mesh:
    """Side by side, not joined."""
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = np.concatenate([mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)])
    return Mesh(
        np.concatenate([m.vertices for m in meshes]), faces.astype(np.int32),
        np.concatenate([m.colors for m in meshes]), np.concatenate([m.sigma for m in meshes]),
        np.concatenate([m.views for m in meshes]),
    )  # fmt: skip


def column_mesh(task: TileTask, found: Found, column: Keys, colored: Column) -> Mesh:
    """All triangles of a column of tiles."""
    patch = column_patch(task, found, column)
    return Mesh(patch.vertices, patch.faces, colored.vertex_colors, patch.sigma, patch.views)


def whole_mesh(task: TileTask, found: Found, colored: partial[Column], count: int, total: int) -> Mesh:
    """The dive in about `count` of its `total` triangles.

    Joined first where that fits into memory; else column by column, whose rims then meet within the simplification's
    error and not exactly.
    """
    columns = columns_of(found.layout)
    if total <= _AT_ONCE:
        return reduced(_joined_mesh(task, found, colored, columns), count)
    parts = []
    for column in columns:
        mesh = column_mesh(task, found, column, colored(column))
        if len(mesh.faces):
            parts.append(reduced(mesh, max(4, round(count * len(mesh.faces) / total))))
    return stacked(parts)


def _joined_mesh(task: TileTask, found: Found, colored: partial[Column], columns: Keys) -> Mesh:
    patches = [column_patch(task, found, column) for column in columns]
    colors = np.concatenate([colored(column).vertex_colors for column in columns])
    first = np.unique(np.concatenate([patch.keys for patch in patches]), return_index=True)[1]
    whole = joined(patches)  # its vertices are in the order of their keys, as `first` is
    kept = without_loose_pieces(whole, task.params.island_faces)
    place = np.searchsorted(whole.keys, kept.keys)
    return Mesh(kept.vertices, kept.faces, colors[first][place], kept.sigma, kept.views)


@dataclass(frozen=True, eq=False)
class Shown:
    """A simple mesh with a texture, and what is known at its vertices.

    Parameters
    ----------
    surface : Surface
    sigma : (N,) float32
        m.
    views : (N,) int32
    """

    surface: Surface
    sigma: FloatImage
    views: NDArray[np.int32]


def within_triangles(shown: Shown, voxel: float) -> FloatImage:
    """Sigma of places on the triangles around each vertex, (N,) float32.

    Parameters
    ----------
    shown : Shown
    voxel : float
        Edge, in the unit of the mesh.

    Notes
    -----
    A place is the mean of three corners, weighted; over a triangle the sum of the squared weights is 1/2 on average.
    That holds where corners err by themselves: not where they are neighbours in the volume.
    """
    faces, vertices = shown.surface.faces, shown.surface.vertices
    edges = np.linalg.norm(vertices[faces] - vertices[np.roll(faces, 1, axis=1)], axis=2)
    share = math.sqrt(0.5) if np.median(edges) > _APART_VOXELS * voxel else 1.0
    return np.asarray(shown.sigma * np.float32(share), np.float32)


def textured(task: TileTask, found: Found, balance: Balance, mesh: Mesh, texel: float) -> Shown:
    """A simpler mesh with a texture from the best views; `texel` is the edge of a texel wanted, m."""
    simple = reduced(mesh, task.params.texture_faces)
    atlas = make_atlas(simple.vertices, simple.faces, texel, task.params.texture_px)
    texture = _texture(task, found, balance, atlas)
    nearest = cKDTree(simple.vertices).query(atlas.vertices)[1]
    uv = np.stack([atlas.uv[:, 0], 1 - atlas.uv[:, 1]], axis=1).astype(np.float32)
    surface = Surface(
        atlas.vertices.astype(np.float32), atlas.faces, vertex_normals(atlas.vertices, atlas.faces), uv,
        simple.colors[nearest], texture, task.world.metric, 0, "world",
    )  # fmt: skip
    return Shown(surface, simple.sigma[nearest], simple.views[nearest])


def from_above(mesh: Mesh, count: int, overview: Overview, world: World) -> Shown:
    """About `count` triangles with the map as their texture: what is shown where nothing else can be made."""
    kept, faces = clustered(mesh.vertices, mesh.faces, count)
    vertices = mesh.vertices[kept]
    rows, columns = overview.color.shape[:2]
    across = (vertices[:, 0] + world.origin[0] - overview.west) / (columns * overview.pixel)
    down = (overview.north - vertices[:, 1] - world.origin[1]) / (rows * overview.pixel)
    surface = Surface(
        vertices.astype(np.float32), faces, vertex_normals(vertices, faces),
        np.stack([across, 1 - down], axis=1).astype(np.float32), mesh.colors[kept],
        np.ascontiguousarray(overview.color[..., :3]), world.metric, 0, "world",
    )  # fmt: skip
    return Shown(surface, mesh.sigma[kept], mesh.views[kept])


def _texture(task: TileTask, found: Found, balance: Balance, atlas: Atlas) -> ByteImage:
    """Drawn column by column of tiles, for the places of all texels are more than the memory has room for."""
    normals, middle = vertex_normals(atlas.vertices, atlas.faces), atlas.vertices[atlas.faces].mean(axis=1)
    columns, owner = np.unique(
        np.floor_divide(middle[:, :2], found.layout.tile_edge).astype(np.int64), axis=0, return_inverse=True
    )

    def colour(k: int) -> tuple[NDArray[np.int64], ByteImage, NDArray[np.bool_]]:
        texels = texels_of(atlas, normals, atlas.faces[owner.reshape(-1) == k])
        best = color_points(task, found, balance, texels.points, texels.normals, found.layout.frames_of(columns[k]))
        return texels.index, best.colors(), best.seen

    colors, seen = np.zeros((atlas.size**2, 3), np.uint8), np.zeros(atlas.size**2, np.bool_)
    for index, got, shown in task.each("texture drawn", colour, range(len(columns))):
        colors[index], seen[index] = got, shown
    side = atlas.size, atlas.size
    return grown(colors.reshape(*side, 3), seen.reshape(side))
