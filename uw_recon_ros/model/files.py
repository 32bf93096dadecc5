"""A fused mesh as PLY and GLB."""

from __future__ import annotations

from typing import Any

import numpy as np
import trimesh

from uw_recon_ros.fuse.extract import FusedMesh
from uw_recon_ros.types import Matrix

#: glTF's axes (y up) from the world's (z up).
_GLTF_FROM_WORLD = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
_VERTEX = (
    ("x", "f4"), ("y", "f4"), ("z", "f4"), ("nx", "f4"), ("ny", "f4"), ("nz", "f4"),
    ("red", "u1"), ("green", "u1"), ("blue", "u1"), ("sigma", "f4"), ("views", "u2"),
)  # fmt: skip
_NAMES = {"f4": "float", "u1": "uchar", "u2": "ushort"}


def ply(mesh: FusedMesh, origin: Matrix, unit: str, *, faces: bool) -> bytes:
    """Vertices with normals, colours, ``sigma`` and ``views`` as binary PLY; with or without the triangles."""
    rows = np.empty(len(mesh.vertices), [(name, f"<{kind}") for name, kind in _VERTEX])
    columns = [*mesh.vertices.T, *_normals(mesh).T, *mesh.colors.T, mesh.sigma, mesh.views]
    for (name, _), column in zip(_VERTEX, columns, strict=True):
        rows[name] = column
    head = ["ply", "format binary_little_endian 1.0", "comment uw_recon_ros: world z up",
            f"comment unit {unit}", "comment add the origin " + " ".join(f"{x:.3f}" for x in origin),
            f"element vertex {len(rows)}", *(f"property {_NAMES[kind]} {name}" for name, kind in _VERTEX)]  # fmt: skip
    if not faces:
        return "\n".join([*head, "end_header", ""]).encode() + rows.tobytes()
    triangles = np.empty(len(mesh.faces), [("n", "u1"), ("corners", "<i4", (3,))])
    triangles["n"], triangles["corners"] = 3, mesh.faces
    head += [f"element face {len(triangles)}", "property list uchar int vertex_indices", "end_header", ""]
    return "\n".join(head).encode() + rows.tobytes() + triangles.tobytes()


def glb(mesh: FusedMesh, origin: Matrix, unit: str) -> bytes:
    """Binary glTF with vertex colours; the node turns z up into y up."""
    drawn = trimesh.Trimesh(mesh.vertices, mesh.faces, vertex_normals=_normals(mesh), process=False)
    opaque = np.concatenate([mesh.colors, np.full((len(mesh.colors), 1), 255, np.uint8)], axis=1)
    drawn.visual = trimesh.visual.ColorVisuals(drawn, vertex_colors=opaque)
    scene = trimesh.Scene()
    scene.add_geometry(drawn, node_name="dive", geom_name="dive", transform=_GLTF_FROM_WORLD)
    scene.metadata.update(unit=unit, origin=[float(x) for x in origin])
    made: Any = scene.export(file_type="glb", include_normals=True)
    return bytes(made)


def _normals(mesh: FusedMesh) -> Matrix:
    """(N, 3) unit normals, triangles weighted by area."""
    corners = mesh.vertices[mesh.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals = np.stack([
        np.bincount(mesh.faces.ravel(), np.repeat(across[:, axis], 3), len(mesh.vertices)) for axis in range(3)
    ], axis=1)  # fmt: skip
    unit: Matrix = normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)
    return unit
