"""How well a calibration from simulated board points knows depth, and whether the sigma it states is honest.

``python test/benchmark/calibration_worth.py [--seeds 8] [--pairs 30] [--tilt 0.4]``: points of a 9x6 board of 40 mm
squares at 0.6 to 2 m with 0.3 px of noise, baseline 0.12 m, f about 1000 px, 1280x960.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))
from helpers.calibration_scenes import BOARD, LARGE, depth_misses, rig_of, sightings

from uw_recon_ros.calibrate.fit import solve
from uw_recon_ros.calibrate.rig import RigNumbers
from uw_recon_ros.calibrate.worth import depth_sigmas

SIZE = (1280, 960)
RANGES_M = (0.5, 1.0, 2.0, 3.0, 5.0)


def one(seed: int, pairs: int, tilt: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Depth errors and stated sigmas, relative, at each range."""
    rig = rig_of(seed, **LARGE)
    fit = solve(sightings(rig, pairs, seed, tilt_rad=tilt), BOARD, SIZE)
    found = RigNumbers(fit.bundle.numbers, SIZE)
    rows = []
    for range_m in RANGES_M:
        misses, sigmas = depth_misses(found, rig, range_m), depth_sigmas(found, fit.bundle.covariance, range_m)[1]
        count = min(len(misses), len(sigmas))
        rows.append((misses[:count], sigmas[:count]))
    return rows


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--pairs", type=int, default=30)
    parser.add_argument("--tilt", type=float, default=0.4)
    args = parser.parse_args()
    runs = [one(seed, args.pairs, args.tilt) for seed in range(1, args.seeds + 1)]
    sys.stdout.write(f"{args.pairs} pairs, tilt sd {args.tilt} rad, {args.seeds} seeds; depth error in percent" + "\n")
    sys.stdout.write(
        "range  middle, worst seed   rms over view, worst seed   worst place, worst seed   within 1 sigma" + "\n"
    )
    for k, range_m in enumerate(RANGES_M):
        misses = [run[k][0] for run in runs]
        middle = max(abs(m[len(m) // 2]) for m in misses)
        rms = max(float(np.sqrt(np.mean(m**2))) for m in misses)
        worst = max(float(np.abs(m).max()) for m in misses)
        within = np.mean([np.mean(np.abs(run[k][0]) <= run[k][1]) for run in runs])
        sys.stdout.write(
            f"{range_m:3g} m  {100 * middle:18.2f}   {100 * rms:25.2f}   {100 * worst:23.2f}   {within:14.0%}" + "\n"
        )


if __name__ == "__main__":
    main()
