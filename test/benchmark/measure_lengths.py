"""Lengths measured in simulated pairs against the truth.

``python test/benchmark/measure_lengths.py [--distances 0.7 1.3 2.5] [--lengths 60]``: point to point between drawn
pixels of the true surface, 0.2 to 1 m apart, through all stages with the true calibration; exact clicks, so that what
is left is the depth's. A length counts as within its sigma without the part of clicking. `--ends-px 0.1`: no matching;
the true disparity of each end errs by that standard deviation: what lengths cannot be better than.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np
from sigma_calibration import view_of

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.measure.quantities import measure_polyline, point_of
from uw_recon_ros.reconstruct.stage import Reconstruct
from uw_recon_ros.trajectory import DisparityFrame


def errors_of(scene: str, distance_m: float, count: int, seed: int) -> tuple[np.ndarray, np.ndarray, int]:
    """Relative errors, errors over sigma, and how many lengths were refused."""
    view = view_of(scene=scene, distance_m=distance_m, seed=seed, width=480, height=360)
    found = Match(MatchParams(effort="balanced"))(view.pair)
    depth = Reconstruct().depth(found)
    kept = np.where(np.isfinite(depth.depth), found.disparity, np.float32(np.nan))
    frame = DisparityFrame(0, view.pair.left, kept, found.sigma, found.geometry)
    rng, rows, refused = np.random.default_rng(seed), [], 0
    height, width = kept.shape
    while len(rows) < count and refused < 3 * count:
        (u0, u1), (v0, v1) = rng.integers(5, width - 5, 2), rng.integers(5, height - 5, 2)
        ends = [point_of(frame.geometry, u, v, float(view.disparity[v, u])) for u, v in ((u0, v0), (u1, v1))]
        true = float(np.linalg.norm(ends[1] - ends[0]))
        if not 0.2 <= true <= 1.0:
            continue
        try:
            made = measure_polyline(frame, [(float(u0), float(v0)), (float(u1), float(v1))])
        except EstimationError:
            refused += 1
            continue
        rows.append((made.value / true - 1, (made.value - true) / made.sigma_disparity))
    errors = np.array(rows)
    return errors[:, 0], errors[:, 1], refused


def errors_of_ends(scene: str, distance_m: float, count: int, seed: int, ends_px: float) -> np.ndarray:
    """Relative errors of lengths between ends whose disparities err by a standard deviation."""
    view = view_of(scene=scene, distance_m=distance_m, seed=seed, width=480, height=360)
    rng, rows = np.random.default_rng(seed), []
    height, width = view.disparity.shape
    while len(rows) < count:
        (u0, u1), (v0, v1) = rng.integers(5, width - 5, 2), rng.integers(5, height - 5, 2)
        lengths = []
        for noise in (np.zeros(2), ends_px * rng.standard_normal(2)):
            ends = [
                point_of(view.pair.geometry, u, v, float(view.disparity[v, u]) + off)
                for u, v, off in ((u0, v0, noise[0]), (u1, v1, noise[1]))
            ]
            lengths.append(float(np.linalg.norm(ends[1] - ends[0])))
        if 0.2 <= lengths[0] <= 1.0:
            rows.append(lengths[1] / lengths[0] - 1)
    return np.array(rows)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--distances", type=float, nargs="+", default=[0.7, 1.3, 2.5])
    parser.add_argument("--scenes", nargs="+", default=["amphora", "reef"])
    parser.add_argument("--lengths", type=int, default=60)
    parser.add_argument("--ends-px", type=float, default=0.0)
    args = parser.parse_args()
    write = sys.stdout.write
    if args.ends_px:
        for scene in args.scenes:
            for distance in args.distances:
                errors = 100 * np.abs(errors_of_ends(scene, distance, args.lengths, 3, args.ends_px))
                write(f"{scene}, {distance:g} m, ends off by {args.ends_px:g} px: mean error {errors.mean():.2f} %, ")
                write(f"95 % under {np.quantile(errors, 0.95):.2f} %\n")
        return
    write("| scene | distance, m | lengths | refused | mean error, % | 95 % under, % | within 1 sigma (disparity) |\n")
    write("|" + " --- |" * 7 + "\n")
    for scene in args.scenes:
        for distance in args.distances:
            relative, over, refused = errors_of(scene, distance, args.lengths, 3)
            write(
                f"| {scene} | {distance:g} | {len(relative)} | {refused} | {100 * np.abs(relative).mean():.2f} | "
                f"{100 * np.quantile(np.abs(relative), 0.95):.2f} | {np.mean(np.abs(over) <= 1):.0%} |\n"
            )
            sys.stdout.flush()


if __name__ == "__main__":
    main()
