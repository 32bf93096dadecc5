"""Errors and sigma on real pairs, at tie points that no matcher of ours has found.

    python test/benchmark/tie_points.py [FOLDER ...] [--efforts navigation balanced] [--sizes 1 0.5]
                                                       [--profiles matching none paper]

A folder holds a left and a right image; without any, the pairs of ``../shared/data`` are taken. Each pair is estimated
and rectified as an uncalibrated one. Its tie points are SIFT features of the rectified raw views (contrast evened out),
matched there and back, moved to sub-pixel places by Lucas and Kanade's method there and back, and kept where those
agree within `AGREE_PX` and the row within `ROW_PX`. What they are off by themselves is told by their rows, which are as
much off: `tie`, px (68 % of what is left of the row offsets after the median around). Columns: tie points with a
disparity, percent; median error, px; more than 1 px wrong, percent of the tie points that have a disparity, and of
those that all matchers have; errors within the root of the squares of sigma and `tie`, percent (68 is honest), and the
factor on sigma that would make it so (errors over `GROSS_PX` left out).
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from drowned_pairs import STEREO, Image
from numpy.typing import NDArray

from uw_recon_ros.errors import ReconError
from uw_recon_ros.match.methods import EFFORTS
from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.preprocess.stage import Preprocess, PreprocessParams
from uw_recon_ros.rectify.stage import Rectify, RectifyParams
from uw_recon_ros.rectify.tracker import RigTracker
from uw_recon_ros.types import RectifiedPair, StereoPair

Floats = NDArray[np.float64]
DATA = STEREO.parent
SHARED = ("underwater/flsea_canyon", "underwater/caddy_diver", "underwater_dim/reef")
AGREE_PX, ROW_PX, RATIO, WINDOW, GROSS_PX = 0.3, 1.0, 0.8, 15, 5.0
SGBM = {"blockSize": 5, "P1": 200, "P2": 800, "disp12MaxDiff": 1, "uniquenessRatio": 10, "speckleWindowSize": 100,
        "speckleRange": 2, "mode": cv2.STEREO_SGBM_MODE_HH}  # fmt: skip


@dataclass(frozen=True, eq=False)
class TiePoints:
    """Pixels (N, 2) of the left view, their disparities (N,), and how exact these are, px."""

    places: Floats
    disparity: Floats
    sigma: float


def read_pair(folder: Path, size: float) -> StereoPair:
    """A folder's two images, scaled."""
    left, right = (cv2.imread(str(next(folder.glob(f"{side}.*")))) for side in ("left", "right"))
    views = (cv2.resize(i, None, fx=size, fy=size, interpolation=cv2.INTER_AREA) for i in (left, right))
    return StereoPair(*(np.ascontiguousarray(view[..., ::-1]) for view in views))


def rectified(raw: StereoPair, profile: str) -> tuple[RectifiedPair, Image, Image]:
    """The pair to match, and the raw views laid alike, gray."""
    enhanced = Preprocess(PreprocessParams(profile=profile))(raw)
    rig = RigTracker(RectifyParams()).update(enhanced)
    stage = Rectify(RectifyParams())
    plain = stage(dataclasses.replace(enhanced, left=raw.left, right=raw.right), rig)
    grays = (cv2.cvtColor(view, cv2.COLOR_RGB2GRAY) for view in (plain.left, plain.right))
    return stage(enhanced, rig), *grays


def tie_points(left: Image, right: Image) -> TiePoints:
    """Of two rectified views."""
    finder = cv2.SIFT_create(6000)
    left, right = (cv2.createCLAHE(3.0, (8, 8)).apply(view) for view in (left, right))
    (here, mine), (there, theirs) = (finder.detectAndCompute(view, None) for view in (left, right))
    matcher = cv2.BFMatcher()
    back = {m.queryIdx: m.trainIdx for m in matcher.match(theirs, mine)}
    kept = [a for a, b in matcher.knnMatch(mine, theirs, k=2) if a.distance < RATIO * b.distance]
    kept = [m for m in kept if back[m.trainIdx] == m.queryIdx]
    start = np.array([here[m.queryIdx].pt for m in kept], np.float32).reshape(-1, 1, 2)
    guess = np.array([there[m.trainIdx].pt for m in kept], np.float32).reshape(-1, 1, 2)
    follow = {"winSize": (WINDOW, WINDOW), "maxLevel": 0, "flags": cv2.OPTFLOW_USE_INITIAL_FLOW}
    end, found, _ = cv2.calcOpticalFlowPyrLK(left, right, start, guess.copy(), **follow)
    again, returned, _ = cv2.calcOpticalFlowPyrLK(right, left, end, start.copy(), **follow)
    start, end, again = start[:, 0], end[:, 0], again[:, 0]
    rows = start[:, 1] - end[:, 1]
    near = (np.linalg.norm(again - start, axis=1) < AGREE_PX) & (np.abs(rows - np.median(rows)) < ROW_PX)
    good = near & (found[:, 0] == 1) & (returned[:, 0] == 1)
    start, end = start[good].astype(np.float64), end[good].astype(np.float64)
    return TiePoints(start, start[:, 0] - end[:, 0], _spread(start, start[:, 1] - end[:, 1]))


def _spread(places: Floats, rows: Floats, around: int = 15) -> float:
    """68 % of what is left of the row offsets after the median of the nearest."""
    apart = np.linalg.norm(places[:, None] - places, axis=-1)
    nearest = np.argsort(apart, axis=1)[:, 1 : around + 1]
    left = rows - np.median(rows[nearest], axis=1)
    return float(np.quantile(np.abs(left), 0.68)) / np.sqrt(1 + np.pi / 2 / around)


def at(values: NDArray[np.float32], places: Floats) -> Floats:
    """Values of a map at places; NaN where its nearest pixel has none."""
    u, v = (np.clip(np.rint(c).astype(int), 0, n - 1) for c, n in zip(places.T, values.shape[::-1], strict=True))
    return values[v, u].astype(np.float64)


def sgbm(pair: RectifiedPair, low: int, high: int) -> NDArray[np.float32]:
    """OpenCV's, tuned, between the limits that ours found."""
    labels = -(-(high - low + 1) // 16) * 16
    matcher = cv2.StereoSGBM_create(minDisparity=low, numDisparities=labels, **SGBM)  # type: ignore[arg-type]
    found = matcher.compute(pair.left_matching, pair.right_matching).astype(np.float32) / 16
    return np.where(found < low, np.float32(np.nan), found).astype(np.float32)


def rows_of(folder: Path, size: float, profile: str, efforts: list[str]) -> list[str]:
    """The table's rows for one pair."""
    pair, *plain = rectified(read_pair(folder, size), profile)
    if pair.geometry.axis == "vertical":
        return [f"| {folder.name}, {size:g}, {profile} | taken for a vertical rig: not measured |" + " |" * 6]
    ties = tie_points(*plain)
    name = f"{folder.name}, {size:g}, {profile} ({len(ties.places)}, tie {ties.sigma:.2f})"
    maps = {effort: Match(MatchParams(effort=effort))(pair) for effort in efforts}
    first = next(iter(maps.values()))
    peer = at(sgbm(pair, first.min_disparity, first.max_disparity), ties.places) - ties.disparity
    errors = {effort: at(found.disparity, ties.places) - ties.disparity for effort, found in maps.items()}
    both = np.isfinite(peer) & np.all([np.isfinite(e) for e in errors.values()], axis=0)
    told = [f"| {name} | SGBM HH | {_errors(peer, both)} | | |"]
    for effort, error in errors.items():
        held, factor = _honesty(error, at(maps[effort].sigma, ties.places), ties.sigma)
        told.append(f"| {name} | {effort} | {_errors(error, both)} | {held:.0f} | {factor:.2f} |")
    return told


def _errors(error: Floats, both: NDArray[np.bool_]) -> str:
    known = np.abs(error[np.isfinite(error)])
    shares = (100 * np.mean(e > 1) if e.size else np.nan for e in (known, np.abs(error[both])))
    middle = np.median(known) if known.size else np.nan
    return f"{100 * np.isfinite(error).mean():.0f} | {middle:.3f} | " + " | ".join(f"{s:.1f}" for s in shares)


def _honesty(error: Floats, sigma: Floats, tie: float) -> tuple[float, float]:
    """Share within, percent; the factor that would make it 68. What is grossly wrong, in either, does not count."""
    counted = np.isfinite(error) & (np.abs(error) < GROSS_PX)
    if not counted.any():
        return float("nan"), float("nan")
    squares, variance = error[counted] ** 2, sigma[counted] ** 2
    factors = np.geomspace(0.1, 10, 401)
    shares = np.array([(squares < f * f * variance + tie * tie).mean() for f in factors])
    best = factors[np.argmin(np.abs(shares - 0.68))]
    return 100 * float((squares < variance + tie * tie).mean()), float(best)


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="*", type=Path, default=[DATA / name for name in SHARED])
    parser.add_argument("--efforts", nargs="+", choices=EFFORTS, default=["navigation", "balanced"])
    parser.add_argument("--sizes", nargs="+", type=float, default=[1.0, 0.5])
    parser.add_argument("--profiles", nargs="+", choices=("matching", "none", "paper"), default=["matching"])
    args = parser.parse_args()
    columns = ("pair, size, profile", "matcher", "known, %", "median, px", "bad-1, %", "bad-1 of both",
               "within sigma, %", "factor")  # fmt: skip
    sys.stdout.write(f"| {' | '.join(columns)} |\n" + "|" + " --- |" * len(columns) + "\n")
    for folder in args.folders:
        for size in args.sizes:
            for profile in args.profiles:
                try:
                    told = rows_of(folder, size, profile, args.efforts)
                except ReconError as error:
                    told = [f"| {folder.name}, {size:g}, {profile} | refused: {error.code} |" + " |" * 6]
                sys.stdout.write("\n".join(told) + "\n")
                sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
