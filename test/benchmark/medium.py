"""Is a calibration made in air and used in water recognised, and is nobody accused who is not?

Usage: python test/benchmark/medium.py [--data ../shared/data/calibration] [--rigs 40]

Real: a board in a tank, calibrated in air and in water, each judged on single pairs in water and in air. Simulated:
random rigs behind flat ports in water, the same in air, in air after they were knocked (0.2 deg), parallel ones in
water.
"""

# ruff: noqa: T201

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "test"))

from helpers.rig_scenes import Rig, calibration_of, make_rig, scatter, through_flat_ports, tie_points  # noqa: E402
from row_limits_tank import calibrate  # noqa: E402

from uw_recon_ros.errors import EstimationError  # noqa: E402
from uw_recon_ros.files.images import read_image  # noqa: E402
from uw_recon_ros.preprocess.stage import Preprocess  # noqa: E402
from uw_recon_ros.rectify import RectifyParams, TiePoints, find_tie_points  # noqa: E402
from uw_recon_ros.rectify.calibrated import rectification_from_calibration  # noqa: E402
from uw_recon_ros.types import StereoCalibration, StereoPair  # noqa: E402

PARAMS = RectifyParams()


def line(what: str, verdicts: Counter[str], metres: int, turned: int) -> None:
    """Print how many said what."""
    counts = ", ".join(f"{name} {count}" for name, count in sorted(verdicts.items()))
    print(
        f"{what:44s} {counts}; metres given {metres}, a turned camera named {turned} of {verdicts.total()}", flush=True
    )


def judge(what: str, cases: Iterator[tuple[StereoCalibration, TiePoints]]) -> None:
    """A line for all pairs of a kind."""
    verdicts, metres, turned = Counter[str](), 0, 0
    for calibration, found in cases:
        rectification = rectification_from_calibration(calibration, PARAMS, found)
        verdicts[rectification.quality.medium or "not looked at"] += 1
        metres += rectification.geometry.metric
        turned += any("turned" in finding.text for finding in rectification.quality.warnings)
    line(what, verdicts, metres, turned)


def tank(data: Path) -> None:
    """Real pairs."""
    pairs = {
        room: [(p, p.parent.parent / "right" / p.name) for p in sorted((data / room / "left").glob("*.png"))]
        for room in ("tank_water", "tank_air")
    }
    size = cv2.imread(str(pairs["tank_water"][0][0]), 0).shape[::-1]
    rigs = {
        "water": calibrate(pairs["tank_water"][::2], (6, 8), size),
        "air": calibrate(pairs["tank_air"], (6, 9), size),
    }
    found: dict[str, list[TiePoints]] = {}
    for room, files in pairs.items():
        for left, right in files:
            try:
                enhanced = Preprocess()(StereoPair(read_image(left), read_image(right)))
                found.setdefault(room, []).append(find_tie_points(enhanced, PARAMS))
            except EstimationError as error:
                print(f"{room} {left.name}: {error}")
    for made, used in (("air", "tank_water"), ("air", "tank_air"), ("water", "tank_water")):
        judge(f"real, calibrated in {made}, {used}", ((rigs[made], points) for points in found[used]))


def simulated(count: int) -> None:
    """Random rigs; tie points with noise of 0.3 px."""
    rng = np.random.default_rng(0)
    angles = [tuple(rng.normal(0, 2.0, 3)) for _ in range(count)]
    knocks = [tuple(np.add(a, rng.normal(0, 0.2, 3))) for a in angles]
    rigs = [make_rig(angles_deg=a, center=(0.15, 0.005, 0.0)) for a in angles]
    moved = [make_rig(angles_deg=a, center=(0.15, 0.005, 0.0)) for a in knocks]
    parallel = make_rig(angles_deg=(0.0, 0.0, 0.0), center=(0.15, 0.0, 0.0))

    def in_water(rig: Rig) -> TiePoints:
        return through_flat_ports(rig, scatter(rig, 400, 1.0, 3.0) * [0.7, 0.7, 1.0], noise=0.3)

    judge("simulated, calibrated in air, in water", ((calibration_of(r), in_water(r)) for r in rigs))
    judge("simulated, as calibrated", ((calibration_of(r), tie_points(r, 400)) for r in rigs))
    judge(
        "simulated, knocked by 0.2 deg, as calibrated",
        ((calibration_of(r), tie_points(m, 400)) for r, m in zip(rigs, moved, strict=True)),
    )
    judge("simulated, parallel cameras, in water", ((calibration_of(parallel), in_water(parallel)) for _ in range(3)))


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data" / "calibration")
    parser.add_argument("--rigs", type=int, default=40)
    arguments = parser.parse_args()
    simulated(arguments.rigs)
    if arguments.data.exists():
        tank(arguments.data)
    else:
        print(f"absent: {arguments.data}")


if __name__ == "__main__":
    main()
