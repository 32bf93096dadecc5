# ruff: noqa: T201
"""The row limits on a real rig: a board in a tank, calibrated from some pairs and judged on others.

    python test/benchmark/row_limits_tank.py [--data ../shared/data/calibration]

Every second water pair calibrates the rig (OpenCV, squares of 25.4 mm), the others are judged; then the same rig
calibrated in air, on all water pairs. The boards of the air pairs are of unknown size, which rows do not show.
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

import cv2
import numpy as np

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.files.calibrations import write_calibration
from uw_recon_ros.pair import read_pair
from uw_recon_ros.preprocess.stage import Preprocess
from uw_recon_ros.rectify import RectifyParams, find_tie_points
from uw_recon_ros.rectify.calibrated import judged, rectification_from_calibration
from uw_recon_ros.rectify.row_error import RowAgreement
from uw_recon_ros.types import CameraModel, StereoCalibration

ROOT = Path(__file__).resolve().parents[2]
SQUARE_M = 0.0254
_EXACT = (cv2.TERM_CRITERIA_EPS + cv2.TERM_CRITERIA_MAX_ITER, 100, 1e-9)


def corners(path: Path, board: tuple[int, int]) -> np.ndarray | None:
    """Corners of the board, (N, 2) float32."""
    found, points = cv2.findChessboardCornersSB(cv2.imread(str(path), 0), board, flags=cv2.CALIB_CB_ACCURACY)
    return points.reshape(-1, 2).astype(np.float32) if found else None


def calibrate(pairs: list[tuple[Path, Path]], board: tuple[int, int], size: tuple[int, int]) -> StereoCalibration:
    """Jointly, from the pairs in which both cameras see the board."""
    grid = np.zeros((board[0] * board[1], 3), np.float32)
    grid[:, :2] = np.mgrid[: board[0], : board[1]].T.reshape(-1, 2) * SQUARE_M
    seen = [(corners(left, board), corners(right, board)) for left, right in pairs]
    lefts, rights = zip(*[(a, b) for a, b in seen if a is not None and b is not None], strict=True)
    grids = [grid] * len(lefts)
    cameras = [cv2.calibrateCamera(grids, points, size, None, None)[1:3] for points in (lefts, rights)]
    (k1, d1), (k2, d2) = cameras
    flags = cv2.CALIB_USE_INTRINSIC_GUESS
    rms, k1, d1, k2, d2, r, t, *_ = cv2.stereoCalibrate(
        grids, lefts, rights, k1, d1, k2, d2, size, criteria=_EXACT, flags=flags
    )
    r1, r2, p1, p2, *_ = cv2.stereoRectify(k1, d1, k2, d2, size, r, t, alpha=0)
    print(f"{len(grids)} pairs: rms {rms:.3f} px, f {k1[0, 0]:.0f} px, baseline {1e3 * np.linalg.norm(t):.1f} mm")
    return StereoCalibration(CameraModel(*size, k1, d1.ravel(), r1, p1), CameraModel(*size, k2, d2.ravel(), r2, p2))


def judge(rig: StereoCalibration, pairs: list[tuple[Path, Path]], what: str) -> None:
    """A line a pair."""
    params = RectifyParams()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "rig.yaml")
        write_calibration(rig, path)
        for left, right in pairs:
            pair = read_pair(left, right, path)
            try:
                found = find_tie_points(Preprocess()(pair), params)
            except EstimationError as error:
                print(f"| {what} | {left.name} | not checked: {error} |")
                continue
            rectification = rectification_from_calibration(rig, params)
            rows = RowAgreement.measured(rectification, found)
            codes = ", ".join(f.code.value for f in judged(rectification, found, params).quality.warnings) or "agrees"
            share = 1e3 * rows.median_px / rows.diagonal_px
            numbers = f"{rows.points} | {rows.median_px:.2f} | {rows.noise_px:.2f} | {share:.2f}"
            print(f"| {what} | {left.name} | {numbers} | {codes} |")


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data" / "calibration")
    data = parser.parse_args().data
    water, air = (
        [(p, p.parent.parent / "right" / p.name) for p in sorted((data / room / "left").glob("*.png"))]
        for room in ("tank_water", "tank_air")
    )
    size = cv2.imread(str(water[0][0]), 0).shape[::-1]
    in_water, in_air = calibrate(water[::2], (6, 8), size), calibrate(air, (6, 9), size)
    print("\n| calibrated | pair | points | rows, median px | noise px | permille of the diagonal | verdict |")
    print("|---|---|--:|--:|--:|--:|---|")
    judge(in_water, water[1::2], "in water, on other pairs")
    judge(in_air, water, "in air, used in water")


if __name__ == "__main__":
    main()
