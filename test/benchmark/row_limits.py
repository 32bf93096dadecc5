# ruff: noqa: T201
"""From which row error on a calibration is wrong: right rigs, and the same rigs with one camera turned.

    python test/benchmark/row_limits.py LEFT RIGHT CALIBRATION [LEFT RIGHT CALIBRATION ...]

For every pair: row error (median, px), the tie points' noise (px), both in thousandths of the diagonal, and what the
limits say, for a right camera turned about each axis by a known angle. A yaw shows in depth and hardly in rows.
"""

from __future__ import annotations

import sys
from dataclasses import replace

import cv2
import numpy as np

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.pair import read_pair
from uw_recon_ros.preprocess.stage import Preprocess, PreprocessParams
from uw_recon_ros.rectify import RectifyParams, find_tie_points
from uw_recon_ros.rectify.calibrated import rectification_from_calibration
from uw_recon_ros.rectify.row_error import RowAgreement
from uw_recon_ros.types import StereoCalibration

ANGLES_DEG = (0.0, 0.02, 0.05, 0.1, 0.2, 0.5)
AXES = {"pitch": (1, 0, 0), "yaw": (0, 1, 0), "roll": (0, 0, 1)}


def turned(rig: StereoCalibration, axis: tuple[int, int, int], degrees: float) -> StereoCalibration:
    turn, _ = cv2.Rodrigues(np.radians(degrees) * np.array(axis, float))
    return replace(rig, right=replace(rig.right, r=turn @ rig.right.r))


def main(arguments: list[str]) -> None:
    params = RectifyParams()
    print(
        "| pair | right camera turned | points | median px | noise px | permille of diagonal | times noise | verdict |"
    )
    print("|---|---|--:|--:|--:|--:|--:|---|")
    for left, right, calibration in zip(*[iter(arguments)] * 3, strict=True):
        pair = read_pair(left, right, calibration)
        assert pair.calibration is not None
        enhanced = Preprocess(PreprocessParams())(pair)
        try:
            found = find_tie_points(enhanced, params)
        except EstimationError as error:
            print(f"| {left} | | {error} |")
            continue
        for name, axis in AXES.items():
            for degrees in ANGLES_DEG if name == "pitch" else ANGLES_DEG[2:]:
                rows = RowAgreement.measured(
                    rectification_from_calibration(turned(pair.calibration, axis, degrees), params), found
                )
                verdict = ", ".join(finding.code.value for finding in rows.findings(params)) or "agrees"
                print(
                    f"| {left} | {name} {degrees:g} deg | {rows.points} | {rows.median_px:.3f} | {rows.noise_px:.3f} | "
                    f"{1e3 * rows.median_px / rows.diagonal_px:.3f} | {rows.median_px / rows.noise_px:.1f} | "
                    f"{verdict} |"
                )


if __name__ == "__main__":
    main(sys.argv[1:])
