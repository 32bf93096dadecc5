"""A model against the truth of a simulated dive: the way, the surface, what is missing."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray

from uw_recon_ros.errors import ModelError
from uw_recon_ros.evaluate_surface import TriangleSearch
from uw_recon_ros.evaluate_trajectory import best_fit, trajectory_errors
from uw_recon_ros.files.trajectories import read_trajectory_csv, read_tum
from uw_recon_ros.model.build import SUMMARY
from uw_recon_ros.rigid import inverse
from uw_recon_ros.survey.report import MODEL
from uw_recon_ros.trajectory import Trajectory
from uw_recon_ros.types import Matrix

COMPLETE_M = 0.01
_MARGIN = 0.02  # share of an image's rim whose bottom need not be modelled


def evaluate_model(survey: str | Path, truth: str | Path) -> dict[str, Any]:
    """Compare the model in a survey's folder with ``trajectory.txt`` and ``surface.ply`` of a simulated dive.

    Returns
    -------
    dict
        ``trajectory`` (see `TrajectoryErrors`), and ``surface``: for each model its median and 95 % distance to the
        truth, bias along the vertical, completeness within 10 mm of what two or more true views show, and the share of
        vertices within one and two sigma.

    Raises
    ------
    ModelError
        There is no model, it has no metres, or the truth cannot be read.
    TrajectoryError
        A trajectory cannot be read, or no stamp is common to both.
    """
    place = Path(survey) / MODEL
    made = _summary(place)
    surface = _surface(Path(truth) / "surface.ply")
    true = read_tum(Path(truth) / "trajectory.txt")
    way = read_trajectory_csv(place / "trajectory.csv")
    models = [m for m in made["models"] if m["vertices"]]
    return {
        "trajectory": trajectory_errors(way, true).as_dict(),
        "surface": [
            {"segment": m["segment"]} | _model_errors(place / m["folder"], made, surface, true) for m in models
        ],
    }


def _summary(place: Path) -> dict[str, Any]:
    try:
        made: dict[str, Any] = json.loads((place / SUMMARY).read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise ModelError(f"{place}: expected a model that uw_recon model finished, got: {error}") from error
    if made["scale"] != "metric":
        raise ModelError(f"{place}: expected a model in metres, its scale is {made['scale']}")
    return made


def _surface(path: Path) -> trimesh.Trimesh:
    try:
        with path.open("rb") as stream:
            mesh = trimesh.load(stream, file_type="ply", process=False)
    except (OSError, ValueError, KeyError, IndexError) as error:
        raise ModelError(f"{path}: expected a mesh, got: {error}") from error
    if not isinstance(mesh, trimesh.Trimesh) or not len(mesh.faces):
        raise ModelError(f"{path}: expected a mesh with triangles, got none")
    return mesh


def _model_errors(folder: Path, made: Mapping[str, Any], surface: trimesh.Trimesh, true: Trajectory) -> dict[str, Any]:
    mesh = _surface(folder / "mesh.ply")
    rotation, shift, common = _laid(folder, true)
    vertices = (np.asarray(mesh.vertices) + np.array(made["origin"])) @ rotation.T + shift
    sigma = np.asarray(mesh.metadata["_ply_raw"]["vertex"]["data"]["sigma"], np.float32).ravel()
    laid = trimesh.Trimesh(vertices, mesh.faces, process=False)
    away, nearest = distances(vertices, surface)
    seen = _seen(np.asarray(surface.vertices), made["camera"], common)
    missed, _ = distances(np.asarray(surface.vertices)[seen], laid)
    return {
        "median_mm": float(1e3 * np.median(away)), "p95_mm": float(1e3 * np.percentile(away, 95)),
        "bias_mm": float(1e3 * np.median(vertices[:, 2] - nearest[:, 2])),
        "completeness_percent": float(100 * (missed <= COMPLETE_M).mean()) if len(missed) else None,
        "within_1_sigma_percent": float(100 * (away <= sigma).mean()),
        "within_2_sigma_percent": float(100 * (away <= 2 * sigma).mean()),
        "vertices": len(vertices), "true_points_seen": int(seen.sum()),
    }  # fmt: skip


def _laid(folder: Path, true: Trajectory) -> tuple[Matrix, Matrix, Trajectory]:
    """Rotation and shift, without scale, of the model's world onto the true one, by the way; the true poses of it."""
    way = read_tum(folder / "trajectory.txt")
    _, ours, theirs = np.intersect1d(way.stamps_ns, true.stamps_ns, return_indices=True)
    if len(ours) < 2:
        raise ModelError(f"{folder}: expected two stamps that are the truth's too, got {len(ours)}")
    steps = np.concatenate([way.rotations[ours, :, k] for k in range(3)]), np.concatenate([
        true.rotations[theirs, :, k] for k in range(3)
    ])  # fmt: skip
    rotation = _turn(*steps)  # a straight way alone leaves a turn about itself open: attitudes do not
    shift = (true.positions[theirs] - way.positions[ours] @ rotation.T).mean(axis=0)
    return rotation, shift, true.picked(theirs)


def _turn(ours: Matrix, theirs: Matrix) -> Matrix:
    """The rotation that lays directions (N, 3) on others; as `best_fit`, whose points they are with their opposites."""
    rotation, _, _ = best_fit(np.concatenate([ours, -ours]), np.concatenate([theirs, -theirs]))
    return rotation


def _seen(points: Matrix, camera: Mapping[str, Any], true: Trajectory) -> NDArray[np.bool_]:
    """Which points two or more true views show, whatever hides them."""
    k, width, height = np.array(camera["intrinsics"]), camera["width"], camera["height"]
    count = np.zeros(len(points), np.int64)
    for pose in true.turned(np.array(camera["rect_from_raw_left"]).T).poses:
        there = inverse(pose)
        local = points @ there[:3, :3].T + there[:3, 3]
        with np.errstate(divide="ignore", invalid="ignore"):
            u, v = (local[:, :2] / local[:, 2:] * [k[0, 0], k[1, 1]] + [k[0, 2], k[1, 2]]).T
        inside = (u > _MARGIN * width) & (u < (1 - _MARGIN) * width) & (v > _MARGIN * height) & (
            v < (1 - _MARGIN) * height)  # fmt: skip
        count += inside & (local[:, 2] > 0)
    return np.asarray(count >= 2, np.bool_)


def distances(points: Matrix, mesh: trimesh.Trimesh) -> tuple[Matrix, Matrix]:
    """(N,) distance of points (N, 3) to a mesh, and (N, 3) the nearest places on it."""
    nearest, _ = TriangleSearch(np.asarray(mesh.triangles, np.float64)).nearest(np.asarray(points, np.float64))
    return np.linalg.norm(nearest - points, axis=1), nearest


def as_table(found: Mapping[str, Any]) -> str:
    """The figures for people."""
    lines = []
    for s in found["trajectory"]["segments"]:
        lines.append(f"trajectory of {s['frames']} frames, {s['path_m']:.2f} m: absolute error "
        f"{1e3 * s['ate_m']:.1f} mm "
                     f"({s['ate_percent']:.3f} %), scale {100 * (s['scale'] - 1):+.2f} %")  # fmt: skip
    for m in found["surface"]:
        complete = "unknown" if m["completeness_percent"] is None else f"{m['completeness_percent']:.1f} %"
        lines.append(f"surface of segment {m['segment']}: median {m['median_mm']:.2f} mm, 95 % {m['p95_mm']:.2f} mm, "
                     f"complete within 10 mm {complete}, within 1 / 2 sigma {m['within_1_sigma_percent']:.0f} / "
                     f"{m['within_2_sigma_percent']:.0f} %")  # fmt: skip
    return "\n".join(lines)
