"""Meshes, clouds and 3D Tiles of a model as files; each appears whole or not at all."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from uw_recon_ros.files.atomic import write_bytes
from uw_recon_ros.files.meshes import GLTF_FROM_WORLD, write_glb
from uw_recon_ros.model.colors import Column, column_grid
from uw_recon_ros.model.mesh import Mesh, column_mesh, reduced
from uw_recon_ros.model.surface import Found, columns_of
from uw_recon_ros.model.work import TileTask, World
from uw_recon_ros.texturing.raster import MapGrid
from uw_recon_ros.texturing.simplify import vertex_normals
from uw_recon_ros.types import Matrix, Surface

_LAZ_STEP_M = 1e-4


_VERTEX = (
    ("x", "f4"), ("y", "f4"), ("z", "f4"), ("nx", "f4"), ("ny", "f4"), ("nz", "f4"),
    ("red", "u1"), ("green", "u1"), ("blue", "u1"), ("sigma", "f4"), ("views", "u2"),
)  # fmt: skip
_NAMES = {"f4": "float", "u1": "uchar", "u2": "ushort"}


def notes_of(world: World) -> dict[str, Any]:
    """What every file says about its coordinates: add `origin` to have those of `crs`."""
    unit = "m" if world.metric else "baselines"
    return {"origin": world.origin.tolist(), "crs": world.crs.text, "unit": unit}


def write_ply(path: Path, mesh: Mesh, world: World, *, faces: bool = True) -> None:
    """Vertices with normals, colours, ``sigma`` and ``views`` as binary PLY; with or without the triangles."""
    rows = np.empty(len(mesh.vertices), [(name, f"<{kind}") for name, kind in _VERTEX])
    normals, views = vertex_normals(mesh.vertices, mesh.faces), mesh.views.clip(0, 65535)
    columns = [*mesh.vertices.T, *normals.T, *mesh.colors.T, mesh.sigma, views]
    for (name, _), column in zip(_VERTEX, columns, strict=True):
        rows[name] = column
    head = ["ply", "format binary_little_endian 1.0", "comment uw_recon_ros: world z up",
            f"comment unit {notes_of(world)['unit']}", f"comment crs {world.crs.text}",
            "comment add the origin " + " ".join(f"{x:.3f}" for x in world.origin),
            f"element vertex {len(rows)}", *(f"property {_NAMES[kind]} {name}" for name, kind in _VERTEX)]  # fmt: skip
    body = rows.tobytes()
    if faces:
        triangles = np.empty(len(mesh.faces), [("n", "u1"), ("corners", "<i4", (3,))])
        triangles["n"], triangles["corners"] = 3, mesh.faces
        head += [f"element face {len(triangles)}", "property list uchar int vertex_indices"]
        body += triangles.tobytes()
    write_bytes(path, "\n".join([*head, "end_header", ""]).encode() + body)


def write_colored(path: Path, mesh: Mesh, world: World) -> None:
    """Write a mesh with vertex colours as binary glTF, y up."""
    drawn = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    opaque = np.c_[mesh.colors, np.full(len(mesh.colors), 255, np.uint8)]
    drawn.visual = trimesh.visual.ColorVisuals(drawn, vertex_colors=opaque)
    scene = trimesh.Scene()
    scene.add_geometry(drawn, node_name="surface", geom_name="surface", transform=GLTF_FROM_WORLD)
    scene.metadata.update(notes_of(world))
    write_bytes(path, bytes(scene.export(file_type="glb")))


def write_textured(path: Path, surface: Surface, world: World) -> None:
    """Write a textured mesh as binary glTF, y up."""
    write_glb(path, surface, axes=GLTF_FROM_WORLD, notes=notes_of(world))


def has_laz() -> bool:
    """Whether the libraries of the extra ``laz`` are installed."""
    return all(find_spec(name) is not None for name in ("laspy", "lazrs"))


def write_cloud(path: Path, meshes: Iterator[Mesh], world: World) -> None:
    """Write all vertices with colour, sigma and number of views as LAZ, one part after the other; needs `has_laz`.

    Coordinates are those of the coordinate system, the origin included, in steps of 0.1 mm.
    """
    import laspy

    header = laspy.LasHeader(version="1.4", point_format=7)
    header.scales, header.offsets = np.full(3, _LAZ_STEP_M), np.floor(world.origin)
    header.generating_software, header.creation_date = "uw_recon_ros", None
    header.add_extra_dims([laspy.ExtraBytesParams("sigma", np.float32), laspy.ExtraBytesParams("views", np.uint16)])
    header.global_encoding.wkt = True
    if world.crs.wkt is not None:
        header.vlrs.append(laspy.vlrs.known.WktCoordinateSystemVlr(world.crs.wkt))
    partial_path = path.with_name(f".{path.name}.part")
    with laspy.open(partial_path, mode="w", header=header, do_compress=True) as writer:
        for mesh in meshes:
            writer.write_points(_points(laspy, header, mesh, world.origin))
    partial_path.replace(path)


def _points(laspy: Any, header: Any, mesh: Mesh, origin: Matrix) -> Any:
    points = laspy.ScaleAwarePointRecord.zeros(len(mesh.vertices), header=header)
    points.x, points.y, points.z = (mesh.vertices + origin).T
    points.red, points.green, points.blue = mesh.colors.astype(np.uint16).T * np.uint16(257)
    points["sigma"], points["views"] = mesh.sigma, mesh.views.clip(0, 65535).astype(np.uint16)
    return points


def write_tiles(task: TileTask, found: Found, colored: partial[Column], share: float) -> int:
    """Write ``tileset.json`` and a textured mesh a column of tiles (3D Tiles 1.1); returns how many.

    Each mesh has the column's part of the orthomosaic as its texture, seen from above. Coordinates are the world's less
    the origin.
    """
    (task.folder / "tiles").mkdir(exist_ok=True)
    children = []
    for column in columns_of(found.layout):
        own = colored(column)
        mesh = column_mesh(task, found, column, own)
        if not len(mesh.faces):
            continue
        name = f"tiles/{column[0]}_{column[1]}.glb"
        simple = reduced(mesh, max(4, round(share * len(mesh.faces))))
        grid = column_grid(found.layout, column, 1)
        write_textured(task.folder / name, _from_above(simple, grid, own, task.world.metric), task.world)
        children.append({"boundingVolume": {"box": _box(simple.vertices)}, "geometricError": 0.0,
                         "content": {"uri": name}})  # fmt: skip
    write_bytes(task.folder / "tileset.json", json.dumps(_tileset(children, task.world), indent=1).encode())
    return len(children)


def _from_above(mesh: Mesh, grid: MapGrid, own: Column, metric: bool) -> Surface:
    edge = grid.cell * grid.columns
    uv = np.stack([(mesh.vertices[:, 0] - grid.west) / edge, 1 - (grid.north - mesh.vertices[:, 1]) / edge], axis=1)
    return Surface(
        mesh.vertices.astype(np.float32), mesh.faces, vertex_normals(mesh.vertices, mesh.faces), uv.astype(np.float32),
        mesh.colors, np.ascontiguousarray(own.color[..., :3]), metric, 0, "world",
    )  # fmt: skip


def _box(points: Matrix) -> list[float]:
    """Centre and half axes."""
    low, high = points.min(axis=0), points.max(axis=0)
    half = np.maximum((high - low) / 2, 1e-6)
    return [*((low + high) / 2).tolist(), half[0], 0.0, 0.0, 0.0, half[1], 0.0, 0.0, 0.0, half[2]]


def _tileset(children: list[dict[str, Any]], world: World) -> dict[str, Any]:
    boxes = np.array([child["boundingVolume"]["box"] for child in children])
    half = boxes[:, [3, 7, 11]]
    corners = np.concatenate([boxes[:, :3] - half, boxes[:, :3] + half])
    box = _box(corners)
    root = {"boundingVolume": {"box": box}, "geometricError": float(np.linalg.norm(box[3:])), "refine": "ADD",
            "children": children}  # fmt: skip
    return {"asset": {"version": "1.1", "extras": notes_of(world)}, "geometricError": root["geometricError"],
            "root": root}  # fmt: skip
