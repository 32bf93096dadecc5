"""How well a calibration from simulated board points knows depth, beside what any solver could, and another's.

``python test/benchmark/calibration_worth.py [--seeds 8] [--pairs 30] [--tilt 0.4] [--alike 0.2 --noise 0.1]``: points
of a 9x6 board of 40 mm squares at 0.6 to 2 m with 0.3 px of noise, baseline 0.12 m, f about 1000 px, 1280x960. The
bound is Cramer and Rao's: one standard deviation that no unbiased solver stays under, with these very pairs. OpenCV's
is ``stereoCalibrate`` with all numbers free, from our guess. Below the table: the worst place of the worst seed that an
ideal solver would show, drawn from the bound, and with what could be known of a camera beforehand.

`--alike`: px by which the points of a view err alike, smoothly over the board (polynomials up to the third power), as
boards that are not flat and rays that do not meet make them. All errors of one seed are errors of one calibration: over
few seeds the share within one sigma says little.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import cv2
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from helpers.calibration_scenes import BOARD, LARGE, depth_misses, erring_alike, rig_of, sightings, truth_of

from uw_recon_ros.calibrate.bundle import SeenPair
from uw_recon_ros.calibrate.depth_error import depth_sigmas
from uw_recon_ros.calibrate.fit import solve
from uw_recon_ros.calibrate.guess import guess_rig
from uw_recon_ros.calibrate.optics import EXTRINSIC, NAMES, PROJECTIONS, SIDES, intrinsic_matrix
from uw_recon_ros.calibrate.rig import RigNumbers
from uw_recon_ros.lenses import PLUMB_BOB
from uw_recon_ros.simulate.boards import hold_boards
from uw_recon_ros.simulate.rig import Pose, Rig

SIZE = (1280, 960)
RANGES_M = (0.5, 1.0, 2.0, 3.0, 5.0)
HELD = [NAMES.index("left_k3"), NAMES.index("right_k3")]
TANGENTIAL = tuple(f"{side}_{name}" for side in ("left", "right") for name in ("p1", "p2"))
SURE = 1e-9  # standard deviation of what is known
KNOWN = {
    "nothing": {},
    "square pixels": {"square": SURE},
    "square pixels, no tangential distortion": {"square": SURE, "tangential": SURE},
    "these, and the principal point within 1 % of the width of the middle": {
        "square": SURE, "tangential": SURE, "middle": 0.01 * SIZE[0],
    },
}  # fmt: skip
DRAWS = 1000


def beforehand(square: float = 0.0, tangential: float = 0.0, middle: float = 0.0) -> np.ndarray:
    """(24, 24) information: standard deviations of fx - fy (px), p1 and p2, cx and cy (px); 0: not known."""
    made = np.zeros((len(NAMES), len(NAMES)))
    for side in ("left", "right"):
        if square:
            aside = (np.array(NAMES) == f"{side}_fx") * 1.0 - (np.array(NAMES) == f"{side}_fy")
            made += np.outer(aside, aside) / square**2
        for names, sigma in (((f"{side}_cx", f"{side}_cy"), middle), (TANGENTIAL, tangential)):
            for name in names if sigma else ():
                made[NAMES.index(name), NAMES.index(name)] = 1 / sigma**2
    return made


def bound(rig: Rig, poses: list[Pose], noise_px: float, known: np.ndarray | None = None) -> np.ndarray:
    """(24, 24) Cramer and Rao's covariance of the rig's numbers, of all unknowns together; `known`: information."""
    numbers, count = truth_of(rig), len(NAMES)
    information = np.zeros((count + 6 * len(poses),) * 2)
    for k, pose in enumerate(poses):
        place = np.concatenate([cv2.Rodrigues(pose.rotation)[0].ravel(), pose.position])
        for project in PROJECTIONS[PLUMB_BOB]:
            _, by_numbers, by_pose = project(numbers, place, BOARD.points())
            slopes = np.zeros((len(by_pose), len(information)))
            slopes[:, :count], slopes[:, count + 6 * k : count + 6 * k + 6] = by_numbers, by_pose
            information += slopes.T @ slopes
    if known is not None:
        information[:count, :count] += noise_px**2 * known
    free = np.setdiff1d(np.arange(len(information)), HELD)
    scale = 1 / np.sqrt(np.diag(information)[free])
    inverse = scale[:, None] * np.linalg.inv(scale[:, None] * information[np.ix_(free, free)] * scale) * scale
    covariance = np.zeros_like(information)
    covariance[np.ix_(free, free)] = noise_px**2 * inverse
    return covariance[:count, :count]


def drawn_misses(rig: Rig, poses: list[Pose], noise_px: float, known: np.ndarray, range_m: float) -> np.ndarray:
    """(DRAWS,) relative errors of depth at the worst place, of rigs drawn from the bound."""
    true, rng = RigNumbers(truth_of(rig), SIZE), np.random.default_rng(1)
    values, vectors = np.linalg.eigh(bound(rig, poses, noise_px, known))
    points, left, right = true.common_view(range_m)
    slopes = []
    for value, vector in zip(values, vectors.T, strict=True):
        step = np.sqrt(max(value, 0.0)) * vector
        there, back = (true.moved(sign * step).located(left, right)[:, 2] for sign in (1, -1))
        slopes.append((there - back) / 2 / points[:, 2])
    return np.abs(rng.standard_normal((DRAWS, len(slopes))) @ np.array(slopes)).max(axis=1)


def tell_ideal(args: argparse.Namespace, range_m: float = 3.0) -> None:
    """What the worst seed of an ideal solver would show, by what is known of the cameras."""
    sys.stdout.write(f"\nworst place of the worst of {args.seeds} seeds at {range_m:g} m, ideal solver, percent\n\n")
    sys.stdout.write("| known beforehand | half of all trials under | nine of ten |\n| --- | --- | --- |\n")
    rigs = [rig_of(seed, **LARGE) for seed in range(1, args.seeds + 1)]
    held = [hold_boards(rig, BOARD, args.pairs, seed, tilt_rad=args.tilt) for seed, rig in enumerate(rigs, 1)]
    for name, known in KNOWN.items():
        rows = [
            np.random.default_rng(seed).permutation(drawn_misses(rig, poses, args.noise, beforehand(**known), range_m))
            for seed, (rig, poses) in enumerate(zip(rigs, held, strict=True))
        ]
        worst = 100 * np.max(rows, axis=0)
        sys.stdout.write(f"| {name} | {np.median(worst):.2f} | {np.quantile(worst, 0.9):.2f} |\n")


def by_opencv(pairs: list[SeenPair]) -> RigNumbers:
    """The rig by another solver of the same equations."""
    numbers, _ = guess_rig(pairs, BOARD.points(), SIZE)
    k, d = [intrinsic_matrix(numbers[side]) for side in SIDES], [np.zeros(5), np.zeros(5)]
    seen = [[getattr(pair, side).pixels.astype(np.float32) for pair in pairs] for side in ("left", "right")]
    flags = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_K3
    found = cv2.stereoCalibrate(
        [BOARD.points().astype(np.float32)] * len(pairs), *seen, k[0], d[0], k[1], d[1], SIZE, flags=flags,
        criteria=(3, 200, 1e-10),
    )  # fmt: skip
    made = np.zeros(len(NAMES))
    for side, matrix, shape in zip(SIDES, (found[1], found[3]), (found[2], found[4]), strict=True):
        made[side] = [matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], *np.ravel(shape)[:5]]
    made[EXTRINSIC] = [*cv2.Rodrigues(found[5])[0].ravel(), *np.ravel(found[6])]
    return RigNumbers(made, SIZE)


def one(seed: int, args: argparse.Namespace) -> list[dict[str, np.ndarray]]:
    """Relative depth errors at each range, ours and OpenCV's, with the sigma that is stated and the bound's."""
    rig = rig_of(seed, **LARGE)
    pairs = sightings(rig, args.pairs, seed, noise_px=args.noise, tilt_rad=args.tilt)
    poses = hold_boards(rig, BOARD, args.pairs, seed, tilt_rad=args.tilt)
    if args.alike:
        pairs = erring_alike(pairs, args.alike, seed)
    fit = solve(pairs, BOARD, SIZE)
    found, true, other = RigNumbers(fit.bundle.numbers, SIZE), RigNumbers(truth_of(rig), SIZE), by_opencv(pairs)
    least = bound(rig, poses, args.noise)
    rows = []
    for range_m in RANGES_M:
        sigmas = depth_sigmas(found, fit.bundle.covariance, range_m, seen_by=true)[1]
        bounds = depth_sigmas(true, least, range_m)[1]
        misses, others = (depth_misses(r, rig, range_m) for r in (found, other))
        rows.append({"ours": misses, "sigma": sigmas, "bound": bounds, "opencv": others})
    return rows


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--pairs", type=int, default=30)
    parser.add_argument("--tilt", type=float, default=0.4)
    parser.add_argument("--noise", type=float, default=0.3, help="px, of each point by itself")
    parser.add_argument("--alike", type=float, default=0.0, help="px, common to the points of a view")
    args = parser.parse_args()
    runs = [one(seed, args) for seed in range(1, args.seeds + 1)]
    write = sys.stdout.write
    write(f"{args.pairs} pairs, tilt sd {args.tilt} rad, {args.noise} px alone, {args.alike} px alike, ")
    write(f"{args.seeds} seeds; error of depth in percent, of the worst seed; bound: one sigma\n\n")
    write("| distance | middle | rms over view | worst place | OpenCV's worst place | bound: middle | ")
    write("bound: worst place, mean of seeds | and worst seed | within 1 sigma |\n|" + " --- |" * 9 + "\n")
    for k, range_m in enumerate(RANGES_M):
        rows = [run[k] for run in runs]
        middle = max(abs(row["ours"][len(row["ours"]) // 2]) for row in rows)
        rms = max(float(np.sqrt(np.mean(row["ours"] ** 2))) for row in rows)
        worst, other = (max(float(np.abs(row[who]).max()) for row in rows) for who in ("ours", "opencv"))
        least = max(row["bound"][len(row["bound"]) // 2] for row in rows)
        corners = [float(row["bound"].max()) for row in rows]
        within = np.mean([np.mean(np.abs(row["ours"]) <= row["sigma"]) for row in rows])
        values = (middle, rms, worst, other, least, float(np.mean(corners)), max(corners))
        write(f"| {range_m:g} m | " + " | ".join(f"{100 * v:.2f}" for v in values) + f" | {within:.0%} |\n")
    tell_ideal(args)


if __name__ == "__main__":
    main()
