"""What each stage of a live pair costs, in one process and without ROS: processor time by function.

Usage: python test/benchmark/live_stages.py [--size 640x480] [--max-disparity 63] [--pairs 12] [--against FOLDER]

A simulated dive goes through the stages with ``config/navigation.yaml``, as far as ``points2_filtered`` and
``depth/image_rect``. With ``--against``, a folder of another version of this package is measured in turn with this one,
pair by pair of runs, so that whatever else the machine does meets both. Processor time of all threads, ms a pair.
"""

# ruff: noqa: T201

from __future__ import annotations

import argparse
import json
import os
import pickle
import statistics
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from inspect import signature
from pathlib import Path
from typing import Any

REPOSITORY = Path(__file__).resolve().parents[2]
STAGES = ("preprocess", "rectify", "match", "depth", "cloud")


def dive(width: int, height: int, pairs: int) -> list[Any]:
    """Raw pairs of a simulated reef, and their cameras, as arrays that any version can read."""
    from uw_recon_ros.simulate.dive import Dive
    from uw_recon_ros.simulate.params import SimulateParams

    made = Dive(SimulateParams(scene="reef", seed=3, width=width, height=height, frames=pairs, rate_hz=10.0))
    frames = [made.frame(index) for index in range(pairs)]
    cameras = [
        (camera.width, camera.height, camera.k, camera.d, camera.r, camera.p)
        for camera in (made.calibration.left, made.calibration.right)
    ]
    return [(f.left, f.right, cameras) for f in frames]


def measure(images: list[Any], max_disparity: int) -> dict[str, float]:
    """Median processor time of each stage, ms a pair; the rig is watched as often as the preset says."""
    import cv2
    import numpy as np

    from uw_recon_ros.match.stage import Match
    from uw_recon_ros.pipeline import PipelineParams, read_values
    from uw_recon_ros.preprocess.sequence import PreprocessSequence
    from uw_recon_ros.reconstruct.stage import Reconstruct
    from uw_recon_ros.rectify.stage import Rectify
    from uw_recon_ros.rectify.tracker import RigTracker
    from uw_recon_ros.types import CameraModel, StereoCalibration, StereoPair

    calibration = StereoCalibration(*(CameraModel(*camera) for camera in images[0][2]))
    pairs = [StereoPair(left, right, i * 100_000_000, "left", calibration) for i, (left, right, _) in enumerate(images)]
    cv2.setNumThreads(1)
    values = read_values(REPOSITORY / "config" / "navigation.yaml")
    values.pop("max_rate_hz", None)
    known = {"min_disparity": 0, "max_disparity": max_disparity}
    params = PipelineParams.from_mapping({**values, **known})
    preprocess, rectify, rig = (
        PreprocessSequence(params.preprocess),
        Rectify(params.rectify),
        RigTracker(params.rectify),
    )
    match, reconstruct = Match(params.match), Reconstruct(params.reconstruct)
    shown = {"shown": False} if getattr(params.reconstruct, "texture", "") == "matching" else {}
    plain = {"normals": False} if "normals" in signature(reconstruct.cloud).parameters else {}  # as the nodes do
    took = defaultdict(list)
    density, points = [], []
    for round_ in range(2):
        for pair in pairs:
            clock = [time.process_time()]
            tick = lambda clock=clock: clock.append(time.process_time())  # noqa: E731
            enhanced = preprocess(pair, **shown)
            tick()
            rectified = rectify(enhanced, rig.update(enhanced, watch=False))
            tick()
            disparity = match(rectified)
            tick()
            depth = reconstruct.depth(disparity)
            tick()
            cloud = reconstruct.thin(reconstruct.cloud(depth, rectified.left, **plain))
            tick()
            if round_:
                for stage, began, ended in zip(STAGES, clock, clock[1:], strict=False):
                    took[stage].append(1e3 * (ended - began))
                density.append(100 * float(np.isfinite(depth.depth).mean()))
                points.append(len(cloud.points))
    return {
        **{stage: statistics.median(took[stage]) for stage in STAGES},
        "density_percent": statistics.mean(density),
        "points": statistics.mean(points),
    }


def elsewhere(folder: Path, stored: Path, max_disparity: int) -> dict[str, float]:
    """The same, of the package in `folder`."""
    script = (
        "import sys, json, pickle, pathlib\n"
        f"sys.path[:0] = [{str(folder)!r}, {str(Path(__file__).parent)!r}]\n"
        "import uw_recon_ros, live_stages\n"
        f"assert pathlib.Path(uw_recon_ros.__file__).parents[1] == pathlib.Path({str(folder)!r})\n"
        f"live_stages.REPOSITORY = pathlib.Path({str(folder)!r})\n"
        f"pairs = pickle.loads(pathlib.Path({str(stored)!r}).read_bytes())\n"
        f"print(json.dumps(live_stages.measure(pairs, {max_disparity})))\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, cwd=folder,
        env={**os.environ, "OPENBLAS_NUM_THREADS": "1"},
    )  # fmt: skip
    found: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return found


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", default="640x480")
    parser.add_argument("--max-disparity", type=int, default=63)
    parser.add_argument("--pairs", type=int, default=6)
    parser.add_argument("--rounds", type=int, default=3, help="of each version")
    parser.add_argument("--against", type=Path, help="folder of another version")
    args = parser.parse_args()
    width, height = map(int, args.size.split("x"))
    versions = {"this": REPOSITORY} | ({"other": args.against.resolve()} if args.against else {})
    results: defaultdict[str, list[dict[str, float]]] = defaultdict(list)
    with tempfile.TemporaryDirectory() as folder:
        stored = Path(folder) / "pairs.pickle"
        stored.write_bytes(pickle.dumps(dive(width, height, args.pairs)))
        for _ in range(args.rounds):
            for name, place in versions.items():
                results[name].append(elsewhere(place, stored, args.max_disparity))
    middle = {
        name: {key: statistics.median(run[key] for run in runs) for key in runs[0]} for name, runs in results.items()
    }
    print(f"{'':18s}" + "".join(f"{name:>10s}" for name in middle))
    for key in next(iter(middle.values())):
        print(f"{key:18s}" + "".join(f"{found[key]:10.1f}" for found in middle.values()))


if __name__ == "__main__":
    main()
