"""What a dive's own tracks can tell of its rig at best: Cramer and Rao's bound, without pictures.

    python test/benchmark/rig_bound.py ["told wrongly" relief ...] [--disparity-px 0.09] [--place-px 0.35]

One standard deviation that no unbiased solver stays under: of the disparities' offset, of the focal length, and of the
scale of the way, where both are unknown (1 px and 1 % beforehand) and where the rig is known. Points of the true bottom
are seen from the true poses, with independent noise, each by a share of the frames that have it in view; poses, points
and rig are unknown together. What is in the way of points (occlusion) is not looked at.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np
from dive_model import DIVES, OTHERS
from numpy.typing import NDArray

from uw_recon_ros.simulate import CourseParams, SimulateParams, SurveyDive
from uw_recon_ros.simulate.params import defaults_on
from uw_recon_ros.simulate.survey_dive import surface_mesh
from uw_recon_ros.types import Matrix

_STEP_M = 0.02
_BEFOREHAND = np.array([1.0, 0.01])  # px, relative
_FIRM = 1e12  # what the first pose is held with


def slopes(points: Matrix, rotations: Matrix, focal: float, baseline: float) -> tuple[Matrix, Matrix, Matrix]:
    """Of u, v, disparity on a pose (t, then w, in the camera), a point and the rig; points in the camera, (N, 3)."""
    x, y, z = points.T
    none, near = np.zeros(len(z)), focal / z
    on_place = np.stack(
        [near, none, -near * x / z, none, near, -near * y / z, none, none, -near * baseline / z], axis=1
    )
    on_place = on_place.reshape(-1, 3, 3)
    cross = np.zeros((len(z), 3, 3))
    cross[:, 0, 1], cross[:, 0, 2], cross[:, 1, 2] = -z, y, -x
    cross -= cross.transpose(0, 2, 1)
    on_pose = on_place @ np.concatenate([-np.broadcast_to(np.eye(3), cross.shape), cross], axis=2)
    on_rig = np.zeros((len(z), 3, 2))
    on_rig[:, 2, 0], on_rig[:, :, 1] = -1.0, np.stack([near * x, near * y, near * baseline], axis=1)
    return on_pose, on_place @ rotations.transpose(0, 2, 1), on_rig


def information(dive: SurveyDive, poses: Matrix, args: argparse.Namespace) -> Matrix:
    """(6N + 2, 6N + 2) of poses and rig, the points eliminated."""
    rng, lens = np.random.default_rng(0), dive.calibration.left
    k = np.asarray(lens.k, np.float64).reshape(3, 3)
    baseline = abs(float(np.reshape(dive.calibration.right.p, (3, 4))[0, 3])) / k[0, 0]
    places = rng.permutation(surface_mesh(dive, _STEP_M)[0])
    count, found = len(poses), np.diag(np.r_[np.zeros(6 * len(poses)), 1 / _BEFOREHAND**2])
    found[:6, :6] += _FIRM * np.eye(6)
    weight = 1 / np.array([args.place_px, args.place_px, args.disparity_px])
    seen = 0
    for place in places:
        inside = np.einsum("nji,nj->ni", poses[:, :3, :3], place - poses[:, :3, 3])
        u, v = (k[0, 0] * inside[:, c] / inside[:, 2] + k[c, 2] for c in (0, 1))
        d = k[0, 0] * baseline / inside[:, 2]
        there = (inside[:, 2] > 0) & (u - d >= 0) & (u < lens.width) & (v >= 0) & (v < lens.height)
        frames = np.flatnonzero(there & (rng.uniform(size=count) < args.found))
        if len(frames) < 2:
            continue
        parts = slopes(inside[frames], poses[frames, :3, :3], k[0, 0], baseline)
        on_pose, on_point, on_rig = (weight[:, None] * part for part in parts)
        wide = np.zeros((len(frames), 3, 6 * len(frames) + 2))
        for n in range(len(frames)):
            wide[n, :, 6 * n : 6 * n + 6] = on_pose[n]
        wide[:, :, -2:] = on_rig
        wide, tall = wide.reshape(3 * len(frames), -1), on_point.reshape(-1, 3)
        own = wide.T @ wide - (wide.T @ tall) @ np.linalg.solve(tall.T @ tall, tall.T @ wide)
        where = np.r_[(6 * frames[:, None] + np.arange(6)).ravel(), 6 * count, 6 * count + 1]
        found[np.ix_(where, where)] += own
        seen += len(frames)
        if seen >= args.a_frame * count:
            break
    return found


def bounds(information: Matrix, poses: Matrix) -> tuple[float, float, float, float]:
    """Sigma of offset, px; of focal length, scale, and scale with the rig known, %."""
    away = poses[:, :3, 3] - poses[:, :3, 3].mean(axis=0)
    pull = np.zeros((len(poses), 6))
    pull[:, :3] = np.einsum("nji,nj->ni", poses[:, :3, :3], away) / (away**2).sum()  # of the way's size on its places
    pull = pull.ravel()
    whole, known = np.linalg.inv(information), np.linalg.inv(information[:-2, :-2])
    offset, focal = np.sqrt(np.diag(whole)[-2:])
    return (
        float(offset), 100 * float(focal), 100 * float(np.sqrt(pull @ whole[:-2, :-2] @ pull)),
        100 * float(np.sqrt(pull @ known @ pull)),
    )  # fmt: skip


def main() -> None:
    """Write the table to standard output."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--disparity-px", type=float, default=0.09, help="noise of a disparity (corrected_sigma.py)")
    parser.add_argument("--place-px", type=float, default=0.35, help="noise of a key point's place")
    parser.add_argument("--a-frame", type=int, default=400, help="key points of a frame that others see too")
    parser.add_argument("--found", type=float, default=0.5, help="share of the frames in view that find a point")
    parser.add_argument("dives", nargs="*", default=["told wrongly", "relief", "return"])
    args = parser.parse_args()
    sys.stdout.write("| dive | offset, px | focal length | scale | scale, rig known |\n" + "| --- " * 5 + "|\n")
    for name in args.dives:
        course, params = (DIVES | OTHERS)[name]
        chosen = CourseParams(**course)
        dive = SurveyDive(SimulateParams.from_mapping(defaults_on(chosen.track) | params), chosen)
        poses: NDArray[np.float64] = dive.true_trajectory().poses
        told = bounds(information(dive, poses, args), poses)
        sys.stdout.write(f"| {name} | {told[0]:.3f} | {told[1]:.2f} % | {told[2]:.3f} % | {told[3]:.3f} % |\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
