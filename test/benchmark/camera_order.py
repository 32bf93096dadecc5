"""Are exchanged cameras recognised, and is nobody accused who is not? Uncalibrated, each pair both ways round.

Usage: python test/benchmark/camera_order.py [--rigs 15] [--data ../shared/data/calibration]

Random rigs (angles of 2 deg), flat floors and scenes of relief, tie points with noise of 0.3 px, lenses with and
without distortion; real: the tank pairs. A right order is accepted, accepted with a warning ("cannot tell"), or refused
as exchanged (wrong); a wrong one is refused, accepted with a warning, or accepted without (wrong).
"""

# ruff: noqa: T201

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "test"))

from helpers.rig_scenes import random_rig, scatter, tie_points_of  # noqa: E402

from uw_recon_ros.errors import EstimationError  # noqa: E402
from uw_recon_ros.files.images import read_image  # noqa: E402
from uw_recon_ros.findings import Code  # noqa: E402
from uw_recon_ros.preprocess.stage import Preprocess  # noqa: E402
from uw_recon_ros.rectify import RectifyParams, TiePoints, estimate_rectification, find_tie_points  # noqa: E402
from uw_recon_ros.types import StereoPair  # noqa: E402

PARAMS = RectifyParams(rig_axis="horizontal")


def verdict(points: TiePoints) -> str:
    """What is said of an order."""
    try:
        warnings = estimate_rectification(points, PARAMS).quality.warnings
    except EstimationError as error:
        return "exchanged" if error.code == Code.RECTIFY_EXCHANGED else "other"
    return "cannot tell" if any(w.code == Code.RECTIFY_ORDER_UNKNOWN for w in warnings) else "accepted"


def line(what: str, found: Iterable[TiePoints]) -> None:
    """Both ways round."""
    words = ("accepted", "cannot tell", "exchanged", "other")
    counts = np.zeros((2, len(words)), int)
    for points in found:
        other = TiePoints(points.right, points.left, points.width, points.height)
        for row, order in enumerate((points, other)):
            counts[row, words.index(verdict(order))] += 1
    right, wrong = (", ".join(f"{w} {n}" for w, n in zip(words, row, strict=True) if n) for row in counts)
    print(f"{what:34s} right order: {right:44s} wrong order: {wrong}", flush=True)


def rigs(count: int, far: float, k1: float) -> Iterable[TiePoints]:
    """Tie points of random rigs."""
    for seed in range(count):
        rig = random_rig(seed)
        lens = np.array([k1, 0, 0, 0, 0.0])
        rig = replace(rig, left=replace(rig.left, d=lens), right=replace(rig.right, d=lens))
        yield tie_points_of(rig, scatter(rig, 300, 1.0, far, seed), 0.3, seed)


def tank(data: Path) -> Iterable[TiePoints]:
    """Of the real pairs."""
    for left in sorted(data.glob("tank_*/left/*.png")):
        try:
            right = left.parent.parent / "right" / left.name
            yield find_tie_points(Preprocess()(StereoPair(read_image(left), read_image(right))), PARAMS)
        except EstimationError as error:
            print(f"{left}: {error}")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rigs", type=int, default=15)
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data" / "calibration")
    arguments = parser.parse_args()
    for far in (3.0, 1.05):
        for k1 in (0.0, -0.1):
            line(f"simulated, 1 to {far:g} m, k1 {k1:g}", rigs(arguments.rigs, far, k1))
    line("real, tank", tank(arguments.data))


if __name__ == "__main__":
    main()
