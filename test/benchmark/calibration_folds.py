"""A real session of a board judged on pairs that the calibration has not seen.

``python test/benchmark/calibration_folds.py FOLDER --size 8x6 --square-mm 25.4 [--splits 20] [--fitted 7]``: FOLDER
holds the stills of both cameras. Pairs are drawn for the fit, and the boards of the others measured by stereo: lengths
across them against the squares, and the depth of their points against that of the board's own pose in the left camera,
whose scale comes from the squares and not from the baseline. Then one pair at a time is left out: the jackknife's
standard deviation of the baseline, beside the one that is stated.
"""

from __future__ import annotations

import argparse
import sys

import cv2
import numpy as np

from uw_recon_ros.board_kinds import CHECKERBOARD
from uw_recon_ros.boards import Board
from uw_recon_ros.calibrate.bundle import SeenPair, adjust
from uw_recon_ros.calibrate.depth_error import length_errors
from uw_recon_ros.calibrate.fit import baseline_sigma, ordered_alike, solve
from uw_recon_ros.calibrate.guess import guess_pose
from uw_recon_ros.calibrate.optics import SIDES, intrinsic_matrix, shape_of
from uw_recon_ros.calibrate.rig import RigNumbers
from uw_recon_ros.calibrate_files import Pictures, see_boards


def depth_errors(rig: RigNumbers, pair: SeenPair, points: np.ndarray) -> np.ndarray:
    """Relative, of each point: by stereo against the board's pose in the left camera alone."""
    camera = rig.numbers[SIDES[0]]
    k, d = intrinsic_matrix(camera), shape_of(camera, rig.lens)
    start = guess_pose(camera, pair.left, points)
    turn, move = cv2.solvePnPRefineLM(
        points[pair.left.numbers], pair.left.pixels, k, d, start[:3].reshape(3, 1), start[3:].reshape(3, 1)
    )
    common, left, right = np.intersect1d(pair.left.numbers, pair.right.numbers, return_indices=True)
    true = points[common] @ cv2.Rodrigues(turn)[0].T + np.ravel(move)
    return rig.located(pair.left.pixels[left], pair.right.pixels[right])[:, 2] / true[:, 2] - 1


def main() -> None:
    """Print what comes of it."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder")
    parser.add_argument("--size", required=True)
    parser.add_argument("--square-mm", type=float, required=True)
    parser.add_argument("--splits", type=int, default=20)
    parser.add_argument("--fitted", type=int, default=7)
    args = parser.parse_args()
    columns, rows = (int(side) for side in args.size.split("x"))
    board = Board(CHECKERBOARD, columns, rows, args.square_mm / 1000)
    seen, _, size = see_boards(Pictures(args.folder, 200), board)
    points, rng, write = board.points(), np.random.default_rng(1), sys.stdout.write
    lengths, depths, baselines = [], [], []
    for _ in range(args.splits):
        order = rng.permutation(len(seen))
        fit = solve([seen[k] for k in order[: args.fitted]], board, size)
        rig = RigNumbers(fit.bundle.numbers, size, fit.lens)
        baselines.append((rig.baseline_m, baseline_sigma(fit.bundle)))
        for k in order[args.fitted :]:
            pair = ordered_alike(seen[k], board)
            lengths.append(100 * length_errors(rig, pair, points).mean())
            depths.append(100 * depth_errors(rig, pair, points).mean())
    whole = solve(seen, board, size)
    stated = RigNumbers(whole.bundle.numbers, size, whole.lens).baseline_m
    write(
        f"{len(seen)} pairs, {args.splits} splits, {args.fitted} pairs in each fit; errors of a board's mean, percent\n"
    )
    for name, values in (("length", np.abs(lengths)), ("depth", np.abs(depths))):
        write(
            f"{name}: median {np.median(values):.2f}, 95 % {np.quantile(values, 0.95):.2f}, worst {values.max():.2f}\n"
        )
    off, sigma = np.array(baselines).T
    write(
        f"baselines of the splits: {1000 * off.min():.2f} to {1000 * off.max():.2f} mm, spread {1000 * off.std():.2f}, "
    )
    write(f"stated {1000 * np.median(sigma):.2f} (median)\n")
    left_out = []
    for k in range(len(whole.pairs)):
        rest = [pair for j, pair in enumerate(whole.pairs) if j != k]
        part = adjust(
            whole.bundle.numbers, np.delete(whole.bundle.poses, k, axis=0), rest, points, whole.bundle.free,
            project=whole.bundle.project,
        )  # fmt: skip
        left_out.append(RigNumbers(part.numbers, size, whole.lens).baseline_m)
    count = len(left_out)
    jackknife = float(np.sqrt((count - 1) / count * ((np.array(left_out) - np.mean(left_out)) ** 2).sum()))
    write(f"baseline {1000 * stated:.2f} mm: stated sigma {1000 * baseline_sigma(whole.bundle):.2f}, ")
    write(f"leaving out one pair at a time {1000 * jackknife:.2f}\n")


if __name__ == "__main__":
    main()
