"""From a finished survey to its model, read top-down."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.drape.from_above import Mosaic, elevation, grid_over
from uw_recon_ros.drape.gains import gains_of
from uw_recon_ros.errors import ModelError
from uw_recon_ros.files.atomic import write_bytes, write_json
from uw_recon_ros.findings import Code, Finding, Severity, worst
from uw_recon_ros.fuse.blocks import touched_blocks
from uw_recon_ros.fuse.extract import FusedMesh
from uw_recon_ros.fuse.tiles import Fusion, fuse
from uw_recon_ros.georeference.geotiff import LOCAL, Place, geotiff
from uw_recon_ros.locate.estimate import Located, estimate_trajectory
from uw_recon_ros.locate.priors import Priors, priors_from_trajectory
from uw_recon_ros.model.files import glb, ply
from uw_recon_ros.model.params import DiveModelParams
from uw_recon_ros.model.shelf import Scales, Shelf
from uw_recon_ros.survey.plan import versions
from uw_recon_ros.system_errors import explain
from uw_recon_ros.trajectory import PoseStatus, Trajectory, read_tum, write_trajectory_csv, write_tum
from uw_recon_ros.types import Matrix

MODEL = "model"
SUMMARY = "model.json"
_LARGE_M = 10_000.0  # positions beyond are moved by an origin, in whole kilometres, before they are float32
Tell = Callable[[str], None]


@dataclass(frozen=True)
class Request:
    """What was asked for.

    Parameters
    ----------
    survey : str
        Folder of a finished survey.
    params : DiveModelParams
    poses : str or None
        File in the TUM format: poses of the left optical frame from outside.
    overwrite : bool
        Whether to make anew what stands there.
    """

    survey: str
    params: DiveModelParams
    poses: str | None = None
    overwrite: bool = False


def build_model(request: Request, tell: Tell) -> dict[str, Any]:
    """Make ``model/`` in a survey's folder; return what ``model.json`` holds.

    Raises
    ------
    ModelError
        Nothing can be made, with the reason.
    """
    shelf = Shelf(request.survey)
    place = Path(request.survey) / MODEL
    if is_built(request.survey) and not request.overwrite:
        raise ModelError(f"{place}: holds a model already: --overwrite makes it anew", Code.MODEL_EXISTS)
    priors, origin = _priors(request, np.array(shelf.read(0).geometry.rect_from_raw_left))
    tell(f"{len(shelf.paths)} frames: looking for where the vehicle was")
    located = estimate_trajectory(shelf.walk(), priors)
    located = replace(located, trajectory=replace(located.trajectory, origin=origin))
    parts = _parts(located.trajectory)
    if not parts:
        text = "expected frames that overlap, no two do: more pairs a second, or slower"
        raise ModelError(f"{request.survey}: {text}", Code.MODEL_NO_OVERLAP)
    try:
        return _written(place, shelf, located, parts, request, tell)
    except OSError as error:
        raise ModelError(f"{place}: stopped: {explain(error)}; what is finished is kept", Code.MODEL_DISK) from error


def is_built(survey: str | Path) -> bool:
    """Whether a survey's folder holds a finished model."""
    return (Path(survey) / MODEL / SUMMARY).exists()


def _priors(request: Request, rect_from_raw: Matrix) -> tuple[Priors | None, Matrix]:
    """Poses from outside, as of the rectified view, and the origin that is taken from them."""
    p = request.params
    if request.poses is None:
        if p.epsg:
            raise ModelError("epsg: expected --poses with it, got none", Code.MODEL_POSES)
        return None, np.zeros(3)
    first = read_tum(request.poses).positions[0]
    origin = np.where(np.abs(first) > _LARGE_M, np.round(first, -3), 0.0)
    given = read_tum(request.poses, origin=origin).turned(rect_from_raw.T)
    return priors_from_trajectory(
        given, p.poses_sigma_m, float(np.radians(p.poses_sigma_deg)), round(p.poses_offset_s * 1e9)
    ), origin


def _parts(trajectory: Trajectory) -> list[NDArray[np.intp]]:
    """Frames to be fused of each segment, the largest first; segments of a single one are none."""
    seen = trajectory.status != int(PoseStatus.PREDICTED)
    parts = [np.flatnonzero(seen & (trajectory.segment == s)) for s in np.unique(trajectory.segment)]
    return sorted((part for part in parts if len(part) > 1), key=lambda part: (-len(part), part[0]))


def _written(
    place: Path, shelf: Shelf, located: Located, parts: list[NDArray[np.intp]], request: Request, tell: Tell
) -> dict[str, Any]:
    place.mkdir(exist_ok=True)
    (place / SUMMARY).unlink(missing_ok=True)
    turn = shelf.read(0).geometry.rect_from_raw_left
    way = located.trajectory.turned(turn)
    write_trajectory_csv(place / "trajectory.csv", way)
    how, cell_m = fusion_of(shelf.scales, request.params)
    models = []
    for rank, part in enumerate(parts):
        number = int(way.segment[part[0]])
        folder = place if rank == 0 else place / f"segment_{number}"
        folder.mkdir(exist_ok=True)
        write_tum(folder / "trajectory.txt", way.picked(way.segment == number))
        tell(f"segment {number}: fusing {len(part)} frames")
        model = _segment(folder, shelf, located, part, how, cell_m, request.params)
        models.append({"segment": number, "folder": folder.relative_to(place).as_posix(), **model})
    made = _summary(shelf, located, models, how, request)
    write_json(place / SUMMARY, made, durable=False)
    return made


def round_up(length: float) -> float:
    """The next 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(length))
    return float(next(round(step * power, 12) for step in (1, 2, 5, 10) if step * power >= length * (1 - 1e-9)))


def fusion_of(scales: Scales, params: DiveModelParams) -> tuple[Fusion, float]:
    """Sizes that were chosen, or follow from the dive; and the cells' side, m.

    Raises
    ------
    ModelError
        No frame has a depth.
    """
    if not (np.isfinite(scales.pixel_m) and np.isfinite(scales.sigma_m)):
        raise ModelError("frames: expected depths in them, got none", Code.MODEL_NOTHING)
    voxel = params.voxel_m or round_up(1.5 * scales.pixel_m)
    max_sigma = params.max_sigma_m or float(f"{3 * scales.sigma_m:.3g}")
    truncation = params.truncation_m or float(f"{max(4 * voxel, 3 * scales.sigma_m):.3g}")
    how = Fusion(voxel, truncation, max_sigma, params.tile_m, params.min_views, params.island_faces)
    return how, params.cell_m or round_up(scales.pixel_m)


def _segment(
    folder: Path, shelf: Shelf, located: Located, part: NDArray[np.intp], how: Fusion, cell_m: float,
    params: DiveModelParams,
) -> dict[str, Any]:  # fmt: skip
    """Fuse one segment and write its files; what is to be said of it."""
    way = located.trajectory

    def view_of(k: int) -> Any:
        return shelf.view(int(part[k]), way.poses[part[k]], located.applied)

    touched = [touched_blocks(view_of(k), how.voxel_m, how.truncation_m, how.max_sigma_m) for k in range(len(part))]
    mesh = fuse(view_of, touched, how)
    if mesh is None:
        return {"frames": len(part), "vertices": 0, "triangles": 0}
    unit = "m" if way.metric else "baselines"
    write_bytes(folder / "mesh.ply", ply(mesh, way.origin, unit, faces=True))
    write_bytes(folder / "mesh.glb", glb(mesh, way.origin, unit))
    write_bytes(folder / "cloud.ply", ply(mesh, way.origin, unit, faces=False))
    maps = _maps(folder, view_of, len(part), mesh, way, how, cell_m, params)
    return {
        "frames": len(part), "vertices": len(mesh.vertices), "triangles": len(mesh.faces),
        "sigma_median": float(np.median(mesh.sigma)), "views_median": float(np.median(mesh.views)), **maps,
    }  # fmt: skip


def _maps(
    folder: Path, view_of: Callable[[int], Any], count: int, mesh: FusedMesh, way: Trajectory, how: Fusion,
    cell_m: float, params: DiveModelParams,
) -> dict[str, Any]:  # fmt: skip
    grid = grid_over(mesh.vertices, cell_m, params.most_cells)
    heights = elevation(mesh.vertices, mesh.faces, grid)
    mosaic = Mosaic(grid, heights)
    tolerance = how.voxel_m + 3 * how.max_sigma_m
    gains = gains_of(view_of, count, mesh.vertices, tolerance)
    for k in range(count):
        view = view_of(k)
        color = np.rint(view.color / gains[k]).clip(0, 255).astype(np.uint8)
        mosaic.add(k, color, view.depth, view.pose, view.intrinsics, tolerance)
    local = LOCAL if way.metric else "local, in baselines of the rig"
    west, north = grid.west + float(way.origin[0]), grid.north + float(way.origin[1])
    place = Place(west, north, grid.cell_m, params.epsg or None, local)
    there = mosaic.best >= 0
    alpha = (255 * there).astype(np.uint8)[..., None]
    write_bytes(folder / "elevation.tif", geotiff(heights + np.float32(way.origin[2]), place, "nan"))
    write_bytes(folder / "orthomosaic.tif", geotiff(np.concatenate([mosaic.colors, alpha], axis=2), place))
    known = np.isfinite(heights)
    return {
        "cell": grid.cell_m, "cells": [grid.rows, grid.columns], "west": west, "north": north,
        "gains": [float(gains.min()), float(gains.max())],
        "area": float(known.sum() * grid.cell_m**2), "coloured_share": float(there.sum() / max(known.sum(), 1)),
        "completeness": float(known.sum() / max(int(_within(known).sum()), 1)),
    }  # fmt: skip


def _within(known: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Cells between the first and the last known one of their row and of their column: what lies within the outline."""
    rows = np.maximum.accumulate(known, axis=1) & np.maximum.accumulate(known[:, ::-1], axis=1)[:, ::-1]
    columns = np.maximum.accumulate(known, axis=0) & np.maximum.accumulate(known[::-1], axis=0)[::-1]
    return np.asarray(rows & columns, np.bool_)


def _summary(
    shelf: Shelf, located: Located, models: list[dict[str, Any]], how: Fusion, request: Request
) -> dict[str, Any]:
    way, geometry = located.trajectory, shelf.read(0).geometry
    findings = [*located.findings, *_findings(shelf, located, models)]
    counts = {str(s): int((way.status == int(s)).sum()) for s in PoseStatus}
    rig = located.rig
    return {
        "scale": "metric" if way.metric else "unknown: lengths are in baselines of the rig",
        "origin": [float(x) for x in way.origin],
        "crs": f"EPSG:{request.params.epsg}" if request.params.epsg else LOCAL if way.metric else "local, baselines",
        "poses": "world <- left optical frame of the camera; world z up",
        "frames": {"kept": len(shelf.paths), "dropped": shelf.dropped, **counts},
        "trajectory": located.statistics,
        "rig": None if rig is None else {"found": asdict(rig.error), "applied": asdict(located.applied)},
        "fusion": asdict(how),
        "camera": {
            "intrinsics": geometry.intrinsics_left.tolist(), "rect_from_raw_left": geometry.rect_from_raw_left,
            "width": shelf.read(0).left.shape[1], "height": shelf.read(0).left.shape[0],
        },
        "models": models,
        "completeness": "share of the cells within the outline of the known ones that have a height",
        "reliable": worst(tuple(findings)) < Severity.UNRELIABLE,
        "warnings": [finding.as_dict() for finding in findings],
        "versions": versions(),
    }  # fmt: skip


def _findings(shelf: Shelf, located: Located, models: list[dict[str, Any]]) -> list[Finding]:
    found = []
    if not located.trajectory.metric:
        text = "the rig's scale is unknown: all lengths are in baselines, none in metres"
        found.append(Finding(Code.MODEL_NOT_METRIC, text, Severity.UNRELIABLE, "give the rig's calibration"))
    if shelf.dropped:
        text = f"{shelf.dropped} frames left out: another scale than the others', or a stamp that does not increase"
        found.append(Finding(Code.MODEL_FRAMES_DROPPED, text))
    if any(model["vertices"] == 0 for model in models):
        text = "a segment has no surface: every pixel is less sure than max_sigma_m, or parts are smaller than islands"
        found.append(Finding(Code.MODEL_NOTHING, text, Severity.UNRELIABLE))
    return found
