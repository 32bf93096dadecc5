"""Clouds and surfaces as files that other programs open: PLY and GLB, written by trimesh.

A file appears whole or not at all: it is written under a temporary name beside its place and then renamed.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from PIL import Image
from trimesh.exchange.ply import export_ply

from uw_recon_ros.errors import ReconError
from uw_recon_ros.files.atomic import write_bytes
from uw_recon_ros.types import ByteImage, Matrix, PointCloud, Surface

#: glTF's axes (y up, looking along -z) from an optical frame's (y down, looking along +z).
GLTF_FROM_OPTICAL = np.diag([1.0, -1.0, -1.0, 1.0])
#: glTF's axes from a world's (z up).
GLTF_FROM_WORLD = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, -1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


def write_ply(path: str | Path, shape: PointCloud | Surface) -> None:
    """Write a cloud or a surface with normals and colours, in the frame it is in, binary little-endian.

    Parameters
    ----------
    path : path
        Overwritten.
    shape : PointCloud or Surface
        Points without coordinates are left out.

    Raises
    ------
    ReconError
        A cloud without any such point.
    OSError
        The file cannot be written.
    """
    write_bytes(path, _surface_ply(shape) if isinstance(shape, Surface) else _cloud_ply(shape))


def _cloud_ply(cloud: PointCloud) -> bytes:
    points = cloud.points.reshape(-1, 3)
    there = np.isfinite(points).all(axis=1)
    if not there.any():
        raise ReconError("cloud: expected at least one point with coordinates, got none: too little was matched")
    drawn = trimesh.PointCloud(points[there], colors=_opaque(cloud.colors.reshape(-1, 3)[there]))
    if cloud.normals is not None:
        drawn.vertex_normals = np.nan_to_num(cloud.normals.reshape(-1, 3)[there])
    ply: bytes = export_ply(drawn, vertex_normal=cloud.normals is not None)
    return ply


def _surface_ply(surface: Surface) -> bytes:
    mesh = _mesh(surface)
    mesh.visual = trimesh.visual.ColorVisuals(mesh, vertex_colors=_opaque(surface.colors))
    ply: bytes = export_ply(mesh, vertex_normal=True)
    return ply


def write_glb(
    path: str | Path, surface: Surface, *, axes: Matrix = GLTF_FROM_OPTICAL, notes: Mapping[str, Any] | None = None
) -> None:
    """Write a textured surface as binary glTF.

    The vertices stay in the surface's frame; the node that holds them turns y up and the view along -z, as glTF wants.

    Parameters
    ----------
    path : path
        Overwritten.
    surface : Surface
        At least one triangle.
    axes : (4, 4) float64
        glTF's axes from the surface's.
    notes : mapping, optional
        For the scene's ``extras``.

    Raises
    ------
    ReconError
        The surface has no triangles (glTF cannot say that).
    OSError
        The file cannot be written.
    """
    if len(surface.faces) == 0:
        raise ReconError(f"{path}: expected a surface of at least one triangle, got none: too little was matched")
    mesh = _mesh(surface)
    material = trimesh.visual.material.PBRMaterial(
        baseColorTexture=Image.fromarray(surface.texture), metallicFactor=0.0, roughnessFactor=1.0, doubleSided=True
    )
    mesh.visual = trimesh.visual.TextureVisuals(uv=surface.uv, material=material)
    scene = trimesh.Scene()
    scene.add_geometry(mesh, node_name="surface", geom_name="surface", transform=axes)
    scene.metadata.update({"unit": "m" if surface.metric else "unknown", "frame_id": surface.frame_id, **(notes or {})})
    glb: bytes = scene.export(file_type="glb", include_normals=True)
    write_bytes(path, glb)


def _mesh(surface: Surface) -> Any:
    return trimesh.Trimesh(surface.vertices, surface.faces, vertex_normals=surface.normals, process=False)


def _opaque(colors: ByteImage) -> ByteImage:
    return np.concatenate([colors, np.full((len(colors), 1), 255, np.uint8)], axis=1)
