"""Fusion, colours and maps alone, from the true poses: surfaces of simulated dives against the truth, CPU, memory."""

from __future__ import annotations

import argparse
import resource
import shutil
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from dive_frames import DiveFrame, dive_frames
from dive_model import DIVES

from uw_recon_ros.evaluate_surface import TriangleSearch, surface_errors
from uw_recon_ros.fuse.frame import PosedFrame
from uw_recon_ros.model.compose import compose
from uw_recon_ros.model.params import DiveModelParams
from uw_recon_ros.model.work import TileTask, World
from uw_recon_ros.simulate import CourseParams, SimulateParams, SurveyDive
from uw_recon_ros.simulate.params import defaults_on
from uw_recon_ros.simulate.survey_dive import surface_mesh

_STEP_M = 0.006
_EVERY = 14  # px between the true points that completeness is judged at


def posed(frame: DiveFrame) -> PosedFrame:
    g = frame.geometry
    depth = g.depth_from_disparity(frame.disparity)
    k = g.intrinsics_left
    lens = np.array([k[0, 0], k[1, 1], k[0, 2], k[1, 2]])
    return PosedFrame(frame.stamp_ns, frame.left, depth, g.depth_sigma(depth, frame.sigma), lens, frame.pose)


def dive_of(name: str) -> SurveyDive:
    course, params = DIVES[name]
    chosen = CourseParams(**course)
    return SurveyDive(SimulateParams.from_mapping(defaults_on(chosen.track) | params), chosen)


def seen_points(dive: SurveyDive, frames: Sequence[DiveFrame]) -> tuple[Any, Any]:
    """True points in view of both cameras of at least one frame; errors of the single depth maps there, m."""
    points, errors = [], []
    for index, frame in zip(dive.taken()[: len(frames)], frames, strict=True):
        height, width = frame.disparity.shape
        g, there = frame.geometry, (slice(None, None, _EVERY), slice(None, None, _EVERY))
        true = dive.true_depth(index, g, width, height)
        u, v = np.meshgrid(np.arange(width), np.arange(height))
        both = (u - g.disparity_from_depth(true) >= 0)[there]
        rays = np.stack([(u - g.cx_left) / g.focal_px, (v - g.cy) / g.focal_px, np.ones(u.shape)], axis=-1)
        points.append((rays * true[..., None])[there][both] @ frame.pose[:3, :3].T + frame.pose[:3, 3])
        errors.append(np.abs(g.depth_from_disparity(frame.disparity) - true)[there].ravel())
    single = np.concatenate(errors)
    return np.concatenate(points), single[np.isfinite(single)]


def row(name: str, frames: list[DiveFrame], folder: Path, params: DiveModelParams) -> str:
    dive, given = dive_of(name), [posed(frame) for frame in frames]
    shutil.rmtree(folder, ignore_errors=True)
    began = time.process_time()
    made = compose(TileTask(given, folder, params, World()))
    cpu = (time.process_time() - began) / len(frames)
    most = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024
    vertices, faces = surface_mesh(dive, _STEP_M)
    points, single = seen_points(dive, frames)
    mesh = trimesh.load(folder / "mesh.ply", process=False)
    found = surface_errors(np.asarray(mesh.vertices), np.asarray(mesh.faces), vertices, faces, truth_points=points)
    sigma = mesh.metadata["_ply_raw"]["vertex"]["data"]["sigma"]
    apart = TriangleSearch(vertices[faces]).distances(np.asarray(mesh.vertices))[0]
    alone = f"{1e3 * np.median(single):.2f} / {1e3 * np.quantile(single, 0.95):.1f}"
    return (
        f"| {name} | {alone} | {1e3 * found.median_m:.2f} / {1e3 * found.p95_m:.1f} "
        f"| {100 * found.completeness:.1f} % | {1e3 * made.statistics['voxel']:g} mm "
        f"| {100 * (apart <= sigma).mean():.0f} / {100 * (apart <= 2 * sigma).mean():.0f} % | {cpu:.2f} | {most} |"
    )


def main() -> None:
    """Write the table to standard output."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=Path, default=Path("bench_out/dives"), help="where frames are kept")
    parser.add_argument("--output", type=Path, default=Path("bench_out/fusion"), help="where models are left")
    parser.add_argument("--effort", default="navigation")
    parser.add_argument("--min-views", type=int, default=DiveModelParams().min_views)
    parser.add_argument("--max-sigma-m", type=float, default=DiveModelParams().max_sigma_m)
    parser.add_argument("--first", type=int, help="only so many frames")
    parser.add_argument("dives", nargs="*", default=["rich", "mud"])
    args = parser.parse_args()
    say, params = sys.stdout.write, DiveModelParams(min_views=args.min_views, max_sigma_m=args.max_sigma_m)
    say("| simulated dive, true poses | single frames: median / 95 % mm | model | complete | voxel | in 1 / 2 sigma "
        "| CPU s a frame | peak MB |\n|" + " --- |" * 8 + "\n")  # fmt: skip
    for name in args.dives:
        frames = dive_frames(args.frames, args.effort, DIVES[name][0], args.first, **DIVES[name][1])
        say(row(name, frames, args.output / name, params) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
