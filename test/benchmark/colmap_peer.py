"""Trajectories beside COLMAP's: ours and pycolmap's of the same frames of a simulated dive, against its truth.

python3 -m venv peer && peer/bin/pip install pycolmap
OPENBLAS_NUM_THREADS=1 python test/benchmark/colmap_peer.py --peer-python peer/bin/python rich --first 17

pycolmap (BSD) runs in a process and an environment of its own. It gets the enhanced, rectified left views and their
exact intrinsics, all pairs matched, and no disparities: its scale is taken from the truth, which ours is not.
"""

from __future__ import annotations

import argparse
import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import cv2
import numpy as np
from dive_frames import DiveFrame, dive_frames
from dive_model import DIVES, tracked, true_way

from uw_recon_ros.evaluate_trajectory import trajectory_errors
from uw_recon_ros.locate.estimate import estimate_trajectory
from uw_recon_ros.trajectory import Trajectory, trajectory_of

PEER = """
import json, sys
import pycolmap
folder, lens = sys.argv[1], sys.argv[2]
database = folder + "/colmap.db"
reader = pycolmap.ImageReaderOptions(camera_model="PINHOLE", camera_params=lens)
pycolmap.extract_features(database, folder + "/images", camera_mode=pycolmap.CameraMode.SINGLE, reader_options=reader)
pycolmap.match_exhaustive(database)
options = pycolmap.IncrementalPipelineOptions(ba_refine_focal_length=False, ba_refine_extra_params=False)
maps = pycolmap.incremental_mapping(database, folder + "/images", folder, options=options)
best = max(maps.values(), key=lambda m: m.num_reg_images())
json.dump({i.name: i.cam_from_world().inverse().matrix().tolist() for i in best.images.values() if i.has_pose},
          open(folder + "/poses.json", "w"))
"""


def by_colmap(frames: list[DiveFrame], python: str, folder: Path) -> tuple[Trajectory, float]:
    """Its trajectory in a scale of its own, and CPU seconds."""
    (folder / "images").mkdir()
    for k, frame in enumerate(frames):
        cv2.imwrite(str(folder / "images" / f"{k:05d}.png"), cv2.cvtColor(frame.left, cv2.COLOR_RGB2BGR))
    k = frames[0].geometry.intrinsics_left
    lens = ",".join(str(x + half) for x, half in ((k[0, 0], 0), (k[1, 1], 0), (k[0, 2], 0.5), (k[1, 2], 0.5)))
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run([python, "-c", PEER, str(folder), lens], check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    found = json.loads((folder / "poses.json").read_text(encoding="utf-8"))
    numbers = sorted((int(name[:5]), np.vstack([pose, [0, 0, 0, 1]])) for name, pose in found.items())
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return trajectory_of([frames[n].stamp_ns for n, _ in numbers], np.array([p for _, p in numbers])), spent


def scaled(way: Trajectory, truth: Trajectory) -> Trajectory:
    """The way in the truth's scale (Umeyama, 1991)."""
    a = way.positions - way.positions.mean(axis=0)
    b = truth.positions[np.isin(truth.stamps_ns, way.stamps_ns)]
    b = b - b.mean(axis=0)
    u, d, v = np.linalg.svd(b.T @ a)
    factor = (d * [1, 1, np.sign(np.linalg.det(u @ v))]).sum() / (a**2).sum()
    poses = way.poses.copy()
    poses[:, :3, 3] *= factor
    return trajectory_of(way.stamps_ns.tolist(), poses)


def row(name: str, way: Trajectory, truth: Trajectory, cpu: float) -> str:
    best = max(trajectory_errors(way, truth).segments, key=lambda s: s.frames)
    drift = " / ".join(f"{value:.2f}" for value in best.drift_percent.values())
    return (
        f"| {name} | {best.frames} of {len(truth)} | {drift} | {1e3 * best.ate_m:.2f} mm, {best.ate_percent:.3f} % "
        f"| {100 * (best.scale - 1):+.2f} % | {cpu / len(truth):.2f} |\n"
    )


def main() -> None:
    """Write the table to standard output."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dive", choices=list(DIVES))
    parser.add_argument("--peer-python", required=True, help="of an environment with pycolmap")
    parser.add_argument("--frames", type=Path, default=Path("bench_out/dives"), help="where frames are kept")
    parser.add_argument("--first", type=int, help="so many frames only")
    args = parser.parse_args()
    course, params = DIVES[args.dive]
    frames = dive_frames(args.frames, "navigation", course, first=args.first, **params)
    truth = true_way(frames)
    sys.stdout.write("| who | frames | drift 1 / 4 / 16 m, % | ATE | scale | CPU s a frame |\n|" + " --- |" * 6 + "\n")
    estimate_trajectory(tracked(frames[:2]))  # kernels compiled
    began = time.process_time()
    ours = estimate_trajectory(tracked(frames)).trajectory
    spent = time.process_time() - began
    sys.stdout.write(
        row("ours", ours, truth, spent) + row("ours, the truth's scale", scaled(ours, truth), truth, spent)
    )
    with tempfile.TemporaryDirectory() as room:
        theirs, spent = by_colmap(frames, args.peer_python, Path(room))
        sys.stdout.write(row("COLMAP, the truth's scale", scaled(theirs, truth), truth, spent))


if __name__ == "__main__":
    main()
