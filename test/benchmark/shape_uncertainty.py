"""Does the stated uncertainty of uncalibrated shapes cover their errors?

Usage: python test/benchmark/shape_uncertainty.py [--rigs 20]

Random rigs, 300 tie points with noise of 0.3 px; relief and lens distortion vary. The error: how far the ratio of
estimated to true depth differs between the farthest and the nearest twentieth, and the focal length from the true one
(both as shares, squared and added). Printed: its median, the median of what is stated, the share of rigs within one
and two stated standard deviations (68 and 95 % where all is well), the median of the distortion found, and how many
were called projective.
"""

# ruff: noqa: T201

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "test"))

from dataclasses import replace  # noqa: E402

from helpers.rig_scenes import Rig, random_rig, scatter, tie_points_of  # noqa: E402

from uw_recon_ros.errors import EstimationError  # noqa: E402
from uw_recon_ros.findings import Code  # noqa: E402
from uw_recon_ros.rectify import RectifyParams, estimate_rectification  # noqa: E402
from uw_recon_ros.rectify.rectification import Rectification  # noqa: E402


def shape_error(rig: Rig, found: Rectification, near: float, far: float) -> float:
    """Percent, on points without noise."""
    points = scatter(rig, 400, near, far, seed=7)
    seen = tie_points_of(rig, points)
    true = (rig.see(points, 0.0, 7)[2] @ rig.left.rotation.T + rig.left.translation)[:, 2]
    parallax = found.geometry.baseline_sign * found.parallax(seen)
    ratio = np.log(1 / np.maximum(parallax, 1e-3) / true)
    order = np.argsort(true)
    twentieth = max(len(order) // 20, 1)
    bent = np.median(ratio[order[-twentieth:]]) - np.median(ratio[order[:twentieth]])
    return 100 * float(np.hypot(bent, np.log(found.geometry.focal_px / rig.left.k[0, 0])))


def table(rigs: int, far: float, k1: float, focal_known: bool) -> None:
    """A line."""
    errors, stated, bent, projective, refused = [], [], [], 0, 0
    for seed in range(rigs):
        rig = random_rig(seed)
        lens = np.array([k1, 0, 0, 0, 0.0])
        rig = replace(rig, left=replace(rig.left, d=lens), right=replace(rig.right, d=lens))
        params = RectifyParams(rig_axis="horizontal", focal_px=float(rig.left.k[0, 0]) if focal_known else 0.0)
        try:
            found = estimate_rectification(tie_points_of(rig, scatter(rig, 300, 1.0, far, seed), 0.3, seed), params)
        except EstimationError:
            refused += 1
            continue
        errors.append(shape_error(rig, found, 1.0, far))
        stated.append(found.quality.shape_sigma_percent)
        bent.append(found.quality.lens_k1 * (rig.left.k[0, 0] / found.geometry.focal_px) ** 2)
        projective += any(f.code == Code.RECTIFY_PROJECTIVE for f in found.quality.warnings)
    error, sigma = np.array(errors), np.array(stated)
    focal = "known" if focal_known else "unknown"
    print(
        f"far {far:4.1f} m, k1 {k1:5.2f}, focal {focal:8s} error {np.median(error):5.1f} %, "
        f"stated {np.median(sigma):5.1f} %, within one {100 * np.mean(error <= sigma):3.0f} %, "
        f"two {100 * np.mean(error <= 2 * sigma):3.0f} %, "
        f"k1 found {np.median(bent):5.2f}, projective {projective}, refused {refused} of {rigs}",
        flush=True,
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, default=20)
    rigs = parser.parse_args().rigs
    for far in (3.0, 1.1):
        for k1 in (0.0, -0.03, -0.12, -0.3, 0.3, 0.7):
            table(rigs, far, k1, focal_known=False)
    table(rigs, 3.0, 0.0, focal_known=True)


if __name__ == "__main__":
    main()
