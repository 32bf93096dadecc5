"""What an odometry's features cost and are worth: on simulated dives against the truth.

Usage: python test/benchmark/odometry_features.py [--frames DIR] [--first N] [dives ...]

Each way joins every frame to those before it; all are judged by the same geometry (`track.relate.relation_of`). CPU is
processor time a frame, all threads, without matching. Error: largest distance from the truth after the first frame is
laid onto it, over the length of the path; drift over a metre; false: steps farther than 5 cm from the truth. Frames
are kept in a folder between runs.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from dive_frames import DiveFrame, dive_frames
from dive_model import DIVES, tracked, true_way

from uw_recon_ros import rigid
from uw_recon_ros.evaluate_trajectory import trajectory_errors
from uw_recon_ros.locate.visual_odometry import Walker, first_poses
from uw_recon_ros.track.keypoints import Keypoints, equalised, sampled, with_disparity
from uw_recon_ros.track.odometry import Odometer
from uw_recon_ros.track.params import OdometryParams, TrackParams
from uw_recon_ros.track.relate import relate
from uw_recon_ros.trajectory import DisparityFrame, trajectory_of
from uw_recon_ros.types import Matrix

FALSE_M = 0.05
Way = Callable[[list[DisparityFrame]], "tuple[Matrix, list[int]]"]


def sift_as_offline(frames: list[DisparityFrame]) -> tuple[Matrix, list[int]]:
    """The survey's own way from frame to frame."""
    walker = Walker(TrackParams())
    for frame in frames:
        walker.add(frame)
    joined = {link.second for link in walker.walk.links}
    return first_poses(len(frames), walker.walk.links), [k for k in range(1, len(frames)) if k not in joined]


def orb(count: int) -> Way:
    """Oriented FAST corners with binary descriptors, matched as RootSIFT's are: bits as a vector of unit length."""
    finder, params = cv2.ORB.create(nfeatures=count, fastThreshold=7), TrackParams(match_ratio=0.9)

    def keypoints(frame: DisparityFrame) -> Keypoints:
        known = with_disparity(frame.disparity, frame.sigma)
        points, found = finder.detectAndCompute(equalised(frame.left, params.clahe_clip), known)
        if found is None:
            return Keypoints(np.zeros((0, 3)), np.zeros(0), np.zeros((0, 256), np.float32))
        pixels = np.array([point.pt for point in points], np.float64)
        d, s = sampled(frame.disparity, pixels), sampled(frame.sigma, pixels)
        kept = np.isfinite(d) & np.isfinite(s)
        bits = (np.unpackbits(found, axis=1).astype(np.float32) * 2 - 1) / 16
        return Keypoints(np.column_stack([pixels, d])[kept], s[kept], bits[kept])

    def walk(frames: list[DisparityFrame]) -> tuple[Matrix, list[int]]:
        poses, lost, motion = [np.eye(4)], [], None
        before = keypoints(frames[0])
        for k, frame in enumerate(frames[1:], 1):
            now = keypoints(frame)
            relation = relate(before, now, frame.geometry, params, motion)
            motion = None if relation is None else relation.motion
            if motion is None:
                lost.append(k)
            poses.append(poses[-1] if motion is None else poses[-1] @ motion)
            before = now
        return np.array(poses), lost

    return walk


def flow(**chosen: float) -> Way:
    """Corners followed by optical flow: what the node does."""

    def walk(frames: list[DisparityFrame]) -> tuple[Matrix, list[int]]:
        odometer = Odometer(OdometryParams.from_mapping(chosen))
        steps = [odometer.add(frame) for frame in frames]
        poses, lost = [np.eye(4)], []
        for k, step in enumerate(steps):
            if step.lost or step.resumed_after_s:
                lost.append(k)
            poses.append(poses[-1] if step.lost else step.pose)
        return np.array(poses[1:]), lost

    return walk


WAYS: dict[str, Way] = {
    "SIFT, 1500 (offline)": sift_as_offline,
    "ORB, 1500": orb(1500),
    "ORB, 500": orb(500),
    "flow, 150 corners": flow(odometry_corners=150),
    "flow, 300 corners": flow(),
    "flow, 600 corners": flow(odometry_corners=600),
    "flow, 300, window 13": flow(odometry_window_px=13),
    "flow, 300, no CLAHE": flow(odometry_clahe_clip=0.0),
}


def row(name: str, way: Way, frames: list[DiveFrame]) -> str:
    """One line of the table."""
    truth = true_way(frames)
    seen = tracked(frames)
    way(seen[:3])
    began = time.process_time()
    poses, lost = way(seen)
    cpu = 1e3 * (time.process_time() - began) / len(frames)
    true = rigid.inverse(truth.poses[0]) @ truth.poses
    path = float(np.linalg.norm(np.diff(true[:, :3, 3], axis=0), axis=1).sum())
    error = float(np.linalg.norm(poses[:, :3, 3] - true[:, :3, 3], axis=1).max())
    steps, real = (rigid.inverse(p[:-1]) @ p[1:] for p in (poses, true))
    false = [k for k, m in enumerate(np.linalg.norm((steps - real)[:, :3, 3], axis=1), 1) if m > FALSE_M]
    (drift,) = trajectory_errors(trajectory_of(truth.stamps_ns, poses), truth).segments
    return (
        f"| {name} | {cpu:.0f} | {100 * error / path:.2f} | {drift.drift_percent.get('1 m', float('nan')):.2f} "
        f"| {len(lost)} | {len(set(false) - set(lost))} |"
    )


def main() -> None:
    """Write the tables to standard output."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=Path, default=Path("bench_out/dives"), help="where frames are kept")
    parser.add_argument("--effort", default="navigation")
    parser.add_argument("--first", type=int, help="frames of each dive; all by default")
    parser.add_argument("--ways", nargs="*", default=list(WAYS))
    parser.add_argument("dives", nargs="*", default=["rich", "mud", "tiles"])
    args = parser.parse_args()
    for dive in args.dives:
        course, params = DIVES[dive]
        frames = dive_frames(args.frames, args.effort, course, args.first, **params)
        sys.stdout.write(
            f"{dive} (simulated, {len(frames)} frames)\n\n| features | CPU ms a frame "
            "| error, % of path | drift over 1 m, % | lost | false |\n|" + " --- |" * 6 + "\n"
        )
        for name in args.ways:
            sys.stdout.write(row(name, WAYS[name], frames) + "\n")
            sys.stdout.flush()
        sys.stdout.write("\n")


if __name__ == "__main__":
    main()
