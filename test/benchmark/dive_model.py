"""Trajectories of simulated dives against the truth: ``make bench-model``; frames are kept in a folder between runs."""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from dive_frames import DiveFrame, dive_frames

from uw_recon_ros import rigid
from uw_recon_ros.evaluate_trajectory import trajectory_errors
from uw_recon_ros.locate.estimate import Located, estimate_trajectory
from uw_recon_ros.locate.params import LocateParams
from uw_recon_ros.locate.priors import priors_from_trajectory
from uw_recon_ros.trajectory import DisparityFrame, Trajectory, trajectory_of

SMALL = {"width": 480, "height": 360}
LOOPS = {"track": "lawnmower", "leg_m": 1.2}
MUD = {"texture": "weak", "water": "7C", "snow_per_m3": 1000.0}
OFF = {"told_disparity_offset_px": 0.3, "told_focal_percent": 0.5}
#: Name: fields of `CourseParams`, of `SimulateParams`.
DIVES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "rich": ({"track": "lawnmower", "leg_m": 2.0}, {"frames": 60}),
    "mud": (LOOPS, {"frames": 40, **MUD, **SMALL}),
    "tiles": ({**LOOPS, "bottom": "tiles"}, {"frames": 32, **SMALL}),
    "told wrongly": (
        {**LOOPS, **OFF},
        {"frames": 40, **SMALL},
    ),
    "two segments": ({"track": "line", "blackout_m": 3.0}, {"frames": 38, **SMALL}),
}
#: More of them, when asked for by name.
OTHERS: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "orbit": ({"track": "orbit"}, {"frames": 30, "seed": 11, **SMALL}),
    "relief": (
        {**LOOPS, "bottom": "relief", "altitude_swing_m": 0.2, "heading_swing_deg": 10.0},
        {"frames": 40, "seed": 7, **SMALL},
    ),
    "told wrongly, swinging": (
        {**LOOPS, "bottom": "relief", "altitude_swing_m": 0.2, "heading_swing_deg": 10.0, **OFF},
        {"frames": 40, "seed": 8, **SMALL},
    ),
    "mud again": (LOOPS, {"frames": 30, "seed": 9, **MUD, **SMALL}),
    "return": ({"track": "return", "leg_m": 1.8}, {"frames": 24, "seed": 21, **SMALL}),
}
FALSE_M = 0.05  # a relation farther from the truth is wrong


def tracked(frames: list[DiveFrame]) -> list[DisparityFrame]:
    return [DisparityFrame(f.stamp_ns, f.left, f.disparity, f.sigma, f.geometry) for f in frames]


def true_way(frames: list[DiveFrame]) -> Trajectory:
    return trajectory_of([f.stamp_ns for f in frames], np.array([f.pose for f in frames]))


def wrong(located: Located, frames: list[DiveFrame], loops: bool) -> int:
    """Relations that are farther from the truth than `FALSE_M`."""
    count = 0
    for link in located.links:
        true = rigid.inverse(frames[link.first].pose) @ frames[link.second].pose
        missed = np.linalg.norm((link.relation.motion - true)[:3, 3])
        count += int((link.kind == "loop") == loops and missed > FALSE_M)
    return count


def row(name: str, frames: list[DiveFrame], params: LocateParams, priors: bool = False) -> str:
    """One line of the table."""
    truth = true_way(frames)
    given = [priors_from_trajectory(truth, 0.05, 0.02)] if priors else []
    began = time.process_time()
    located = estimate_trajectory(tracked(frames), given, params)
    cpu = (time.process_time() - began) / len(frames)
    errors = trajectory_errors(located.trajectory, truth)
    best = max(errors.segments, key=lambda s: s.frames) if errors.segments else None
    figures = (
        f"{best.drift_percent['1 m']:.2f} / {best.drift_percent['4 m']:.2f} | {1e3 * best.ate_m:.1f} mm, "
        f"{best.ate_percent:.3f} % | {100 * (best.scale - 1):+.2f} %"
        if best
        else "- | - | -"
    )
    counts = located.statistics
    rig = located.rig
    offset = f"{rig.error.offset_px:+.2f} ({rig.offset_sigma_px:.2f})" if rig else "-"
    return (
        f"| {name} | {figures} | {counts['segments']} | {counts['bridges']}, {errors.predicted} | {counts['loops']} of "
        f"{counts['loops_tried']} | {wrong(located, frames, True)}, {wrong(located, frames, False)} | {offset} | "
        f"{cpu:.2f} |"
    )


def main() -> None:
    """Write the table to standard output."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=Path, default=Path("bench_out/dives"), help="where frames are kept")
    parser.add_argument("--effort", default="navigation")
    parser.add_argument("dives", nargs="*", default=list(DIVES), help=f"or of {', '.join(OTHERS)}")
    args = parser.parse_args()
    say = sys.stdout.write
    say("| simulated dive | drift 1 / 4 m, % | ATE | scale | segments | bridged, predicted | loops "
        "| wrong loops, steps | offset found, px (sigma) | CPU s a frame |\n|" + " --- |" * 10 + "\n")  # fmt: skip
    plain = LocateParams(loops_a_frame=0, self_calibrate=False)
    for name in args.dives:
        course, params = (DIVES | OTHERS)[name]
        frames = dive_frames(args.frames, args.effort, course, **params)
        say(row(f"{name}, frame to frame", frames, plain) + "\n")
        say(row(f"{name}, with loops, no bundles", frames, LocateParams(bundle=False)) + "\n")
        say(row(f"{name}, with loops", frames, LocateParams()) + "\n")
        if name == "rich":
            kept = np.random.default_rng(0).uniform(size=len(frames)) >= 0.2
            fewer = [f for f, k in zip(frames, kept, strict=True) if k]
            say(row("rich, 20 % of the frames lost", fewer, LocateParams()) + "\n")
            dark = [replace(f, left=np.zeros_like(f.left)) if k % 9 == 5 else f for k, f in enumerate(frames)]
            say(row("rich, every ninth picture black", dark, LocateParams()) + "\n")
        if name == "tiles":
            say(row("tiles, poses from outside (5 cm)", frames, LocateParams(), priors=True) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
