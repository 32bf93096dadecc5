"""From posed frames to surface, colours and maps, as files: reads top-down as what is done."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from uw_recon_ros.errors import ModelError
from uw_recon_ros.findings import Code, Finding
from uw_recon_ros.model.colors import Column, balance_of, color_all, column_of
from uw_recon_ros.model.files import has_laz, write_cloud, write_colored, write_ply, write_textured, write_tiles
from uw_recon_ros.model.maps import Mapped, Overview, pixels_a_voxel, write_maps
from uw_recon_ros.model.mesh import Mesh, Shown, column_mesh, from_above, textured, whole_mesh
from uw_recon_ros.model.params import DiveModelParams
from uw_recon_ros.model.surface import Found, columns_of, fuse_all, look_through
from uw_recon_ros.model.work import TileTask
from uw_recon_ros.texturing.gains import Balance
from uw_recon_ros.texturing.simplify import has_extra

_MANY_COLUMNS = 4  # tiles, beyond which 3D Tiles are worth it
_FEW_FACES = 1000  # that are not worth simplifying


@dataclass(frozen=True, eq=False)
class Composed:
    """What `compose` leaves.

    Parameters
    ----------
    files : tuple of str
        Relative to the task's folder.
    findings : tuple of Finding
    statistics : dict
        For ``model.json``.
    shown : Shown
    overview : Overview
        For the page.
    """

    files: tuple[str, ...]
    findings: tuple[Finding, ...]
    statistics: dict[str, Any]
    shown: Shown
    overview: Overview


def compose(task: TileTask) -> Composed:
    """Fuse frames of one frame of reference into one textured surface and maps, and write them.

    A killed run that is started again with the same frames and parameters goes on where it was and leaves the same
    bytes; so does any number of jobs.

    Raises
    ------
    ModelError
        There is no surface, or an extra that was asked for is not installed.
    OSError
        A file cannot be written.
    """
    _expect_laz(task.params)
    task.folder.mkdir(parents=True, exist_ok=True)
    found = look_through(task)
    total = fuse_all(task, found)
    balance = balance_of(task, found)
    per_voxel = pixels_a_voxel(found.layout, task.params.cells_a_voxel, task.params.most_cells)
    color_all(task, found, balance, per_voxel)
    colored = partial(column_of, task, found, balance, per_voxel)
    mesh = whole_mesh(task, found, colored, _target(task.params, total), total)
    files = list(_plain(task, found, colored, mesh))
    mapped = write_maps(task, found, colored, per_voxel)
    shown = _glb(task, found, balance, mesh, mapped)
    files += ["mesh.glb", *mapped.files, *_tiles(task, found, colored)]
    findings = tuple(_findings(task, mapped, per_voxel))
    shutil.rmtree(task.work)
    statistics = _statistics(task, found, balance, mapped, mesh, total)
    return Composed(tuple(files), findings, statistics, shown, mapped.overview)


def _expect_laz(params: DiveModelParams) -> None:
    if params.cloud_format == "laz" and not has_laz():
        text = "cloud_format laz: expected the extra 'laz': pip install '.[laz]' in the sources' folder"
        raise ModelError(text, Code.MODEL_EXTRA_ABSENT)


def _target(params: DiveModelParams, total: int) -> int:
    """Triangles of the mesh: all of them where nothing can simplify it."""
    if not has_extra():
        return total
    return min(params.mesh_faces, max(_FEW_FACES, round(params.mesh_share * total)))


def _plain(task: TileTask, found: Found, colored: partial[Column], mesh: Mesh) -> Iterator[str]:
    """Write mesh and cloud; yield their names."""
    write_ply(task.folder / "mesh.ply", mesh, task.world)
    yield "mesh.ply"
    name = f"cloud.{task.params.cloud_format}"
    if task.params.cloud_format == "ply":
        write_ply(task.folder / name, mesh, task.world, faces=False)
    else:
        columns = columns_of(found.layout)
        write_cloud(
            task.folder / name, (column_mesh(task, found, column, colored(column)) for column in columns), task.world
        )
    yield name


def _glb(task: TileTask, found: Found, balance: Balance, mesh: Mesh, mapped: Mapped) -> Shown:
    """Write ``mesh.glb``, with a texture where the extra is there; what a page shows of it."""
    if not has_extra():
        write_colored(task.folder / "mesh.glb", mesh, task.world)
        return from_above(mesh, task.params.texture_faces, mapped.overview, task.world)
    shown = textured(task, found, balance, mesh, mapped.pixel)
    write_textured(task.folder / "mesh.glb", shown.surface, task.world)
    return shown


def _tiles(task: TileTask, found: Found, colored: partial[Column]) -> list[str]:
    wanted = task.params.tiles
    if wanted == "never" or (wanted == "auto" and len(columns_of(found.layout)) <= _MANY_COLUMNS):
        return []
    write_tiles(task, found, colored, task.params.mesh_share if has_extra() else 1.0)
    return ["tileset.json"]


def _findings(task: TileTask, mapped: Mapped, per_voxel: float) -> Iterator[Finding]:
    if not has_extra():
        text = "the mesh is not simplified and has no texture: fast-simplification is not installed"
        yield Finding(Code.MODEL_EXTRA_ABSENT, text, advice="pip install '.[model]' in the sources' folder")
    if per_voxel < task.params.cells_a_voxel:
        text = f"the orthomosaic's cells are {1000 * mapped.pixel:g} mm, larger than asked for, to stay in most_cells"
        yield Finding(Code.MODEL_COARSENED, text, advice="raise most_cells")


def _statistics(
    task: TileTask, found: Found, balance: Balance, mapped: Mapped, mesh: Mesh, total: int
) -> dict[str, Any]:
    layout, gains = found.layout, np.exp(balance.gains)
    return {
        "frames": len(task.frames), "frames_without_depth": int(np.isnan(layout.reaches[:, 0, 0]).sum()),
        "vertices": len(mesh.vertices), "triangles": len(mesh.faces), "triangles_before_simplification": total,
        "voxel": layout.voxel, "blocks": len(layout.keys), "tiles": len(layout.tiles), "min_views": found.least_views,
        "max_sigma": found.max_sigma,
        "sigma_median": float(np.median(mesh.sigma)), "views_median": float(np.median(mesh.views)),
        "gains": [float(gains.min()), float(gains.max())], **mapped.as_dict(),
    }  # fmt: skip
