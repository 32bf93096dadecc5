# ruff: noqa: T201
"""Uncalibrated rectification beside OpenCV's: row error on matches of neither fit, distortion of the images.

    python test/benchmark/rectify_quality.py [--rigs 30] [--data FOLDER]

Real pairs are preprocessed, three quarters of their tie points fitted, the rest measured (three splits). Synthetic rigs
are random (the cameras of `test/rectify/rig_scenes.py`), their tie points noisy (0.4 px), fresh ones without noise
measured. The last table is about the prior of the fit: rows, focal length and the disparity of infinity, in percent of
the median disparity, on scenes of little relief where matches leave much open.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "test"))

from helpers.rig_scenes import Rig, intrinsics, random_rig, tie_points, tie_points_of  # noqa: E402

from uw_recon_ros.errors import EstimationError  # noqa: E402
from uw_recon_ros.files.images import read_image  # noqa: E402
from uw_recon_ros.preprocess.stage import Preprocess, PreprocessParams  # noqa: E402
from uw_recon_ros.rectify import RectifyParams, TiePoints, estimate_rectification, find_tie_points  # noqa: E402
from uw_recon_ros.rectify.quality import homography_distortion  # noqa: E402
from uw_recon_ros.rectify.quasi_euclidean import fit_quasi_euclidean  # noqa: E402
from uw_recon_ros.rectify.sampson import homogeneous  # noqa: E402
from uw_recon_ros.types import StereoPair  # noqa: E402

Array = NDArray[np.float64]
Homographies = tuple[Array, Array]
ALWAYS = RectifyParams(given_limit_px=0.0, tie_held_out=0.05, rig_axis="horizontal")


def ours(points: TiePoints) -> Homographies:
    found = estimate_rectification(points, ALWAYS)
    return found.left.homography, found.right.homography


def opencv(points: TiePoints) -> Homographies:
    fundamental, _ = cv2.findFundamentalMat(points.left, points.right, cv2.FM_8POINT)
    size = points.width, points.height
    done, left, right = cv2.stereoRectifyUncalibrated(points.left, points.right, fundamental, size, threshold=5)
    if not done:
        raise EstimationError("stereoRectifyUncalibrated returned false")
    return left, right


METHODS: dict[str, Callable[[TiePoints], Homographies]] = {"ours": ours, "OpenCV uncalibrated": opencv}


def rows(found: Homographies, points: TiePoints) -> Array:
    left, right = (homogeneous(p) @ h.T for p, h in zip((points.left, points.right), found, strict=True))
    return left[:, 1] / left[:, 2] - right[:, 1] / right[:, 2]


def measure(fitted: TiePoints, fresh: TiePoints) -> dict[str, list[float]]:
    """Method -> rms and median row error, worst aspect, worst angle, CPU ms; inf where refused."""
    result = {}
    for name, method in METHODS.items():
        started = time.process_time()
        try:
            found = method(fitted)
        except EstimationError:
            result[name] = [np.inf] * 5
            continue
        spent = 1e3 * (time.process_time() - started)
        shapes = [homography_distortion(h, fitted.width, fitted.height) for h in found]
        error = rows(found, fresh)
        aspect = max((s.aspect for s in shapes), key=lambda a: abs(np.log(a)))
        angle = max((s.angle_deg for s in shapes), key=lambda a: abs(a - 90))
        result[name] = [float(np.sqrt(np.mean(error**2))), float(np.median(np.abs(error))), aspect, angle, spent]
    return result


def table(title: str, trials: list[dict[str, list[float]]]) -> None:
    print(f"\n{title}")
    print(f"{'':22}{'row rms: median':>16}{'90 %':>8}{'worst':>8}{'aspect':>16}{'angle deg':>16}{'CPU ms':>8} failed")
    for name in METHODS:
        values = np.array([trial[name] for trial in trials])
        held = values[np.isfinite(values[:, 0])]
        if not len(held):
            print(f"{name:22}all {len(values)} failed")
            continue
        middle, high = np.quantile(held[:, 0], [0.5, 0.9])
        aspect = f"{held[:, 2].min():.2f} to {held[:, 2].max():.2f}"
        angle = f"{held[:, 3].min():.0f} to {held[:, 3].max():.0f}"
        print(
            f"{name:22}{middle:16.3f}{high:8.3f}{held[:, 0].max():8.3f}{aspect:>16}{angle:>16}"
            f"{np.median(held[:, 4]):8.0f}{len(values) - len(held):7d}"
        )


def real(folder: Path) -> None:
    for name in ("flsea_canyon", "caddy_diver"):
        if not (folder / name).is_dir():
            print(f"\n{name}: not in {folder}, left out")
            continue
        pair = StereoPair(*(read_image(path) for path in sorted((folder / name).iterdir())))
        points = find_tie_points(Preprocess(PreprocessParams())(pair), RectifyParams())
        trials = []
        for seed in range(3):
            held = np.random.default_rng(seed).random(len(points)) < 0.25
            trials.append(measure(points.take(~held), points.take(held)))
        table(f"{name}: {len(points)} tie points, held out: a quarter, three splits", trials)


def relief(rig: Rig, count: int, seed: int, roughness: float) -> Array:
    """Points of a tilted surface about 1.5 m away, its depth varying by `roughness` (a share)."""
    rng = np.random.default_rng(seed)
    pixels = rng.uniform((0, 0), (rig.width - 1, rig.height - 1), (count, 2))
    tilt = rng.normal(0, 0.3, 2) / rig.width
    depth = 1.5 / (1 + (pixels - [rig.width / 2, rig.height / 2]) @ tilt) * np.exp(rng.normal(0, roughness, count))
    return np.asarray(homogeneous(pixels) @ np.linalg.inv(rig.left.k).T * depth[:, None])


def synthetic(count: int) -> None:
    for angle in (2.0, 6.0):
        trials = []
        for seed in range(count):
            rig = random_rig(seed, angle_deg=angle)
            fitted, fresh = (
                tie_points(rig, 300, noise=0.4, seed=seed),
                tie_points(rig, 300, noise=0.0, seed=seed + 5000),
            )
            if min(len(fitted), len(fresh)) >= 40:
                trials.append(measure(fitted, fresh))
        table(f"{len(trials)} random rigs, angles of {angle:g} deg (standard deviation), points 1 to 3 m away", trials)


def with_distortion(rig: Rig, k1: float) -> Rig:
    d = np.array([k1, 0.0, 0.0, 0.0, 0.0])
    return replace(rig, left=replace(rig.left, d=d), right=replace(rig.right, d=d))


def prior_trial(seed: int, roughness: float, k1: float, weight: float) -> tuple[float, float, float] | None:
    rig = with_distortion(random_rig(seed), k1)
    fitted = tie_points_of(rig, relief(rig, 150, seed, roughness), 0.4, seed)
    fresh = tie_points_of(rig, relief(rig, 300, seed + 5000, roughness))
    if min(len(fitted), len(fresh)) < 40:
        return None
    found = fit_quasi_euclidean(fitted.left, fitted.right, rig.width, rig.height, prior_weight=weight)
    k = intrinsics(rig.width, rig.height, found.focal_px)
    pair = tuple(k @ r @ np.linalg.inv(k) for r in (found.rotation_left, found.rotation_right))
    centre = np.array([*rig.left.k[:2, 2], 1.0])
    left, right = pair[0] @ centre, pair[1] @ rig.right.k @ rig.right.rotation @ np.linalg.inv(rig.left.k) @ centre
    infinity = left[0] / left[2] - right[0] / right[2]
    moved = [homogeneous(p) @ h.T for p, h in zip((fresh.left, fresh.right), pair, strict=True)]
    disparity = np.median(np.abs(moved[0][:, 0] / moved[0][:, 2] - moved[1][:, 0] / moved[1][:, 2] - infinity))
    row = float(np.sqrt(np.mean(rows((pair[0], pair[1]), fresh) ** 2)))
    return row, abs(float(np.log(found.focal_px / rig.left.k[0, 0]))), abs(infinity) / float(disparity)


def prior(count: int) -> None:
    print("\nprior of the fit: median / 90 % of row rms (px), focal length (%), infinity (% of the median disparity)")
    for roughness, k1 in ((0.1, 0.0), (0.03, 0.0), (0.1, -0.03), (0.03, -0.03)):
        print(f"  relief {roughness:.0%}, lens distortion k1 = {k1:g}")
        for weight in (0.0, 0.25, 1.0, 4.0, 16.0):
            trials = [prior_trial(seed, roughness, k1, weight) for seed in range(count)]
            values = np.array([t for t in trials if t is not None])
            middle, high = np.quantile(values, [0.5, 0.9], axis=0)
            print(
                f"    rig_prior_weight {weight:5.2f}: rows {middle[0]:.3f} / {high[0]:.3f}   focal "
                f"{100 * middle[1]:5.1f} / {100 * high[1]:5.1f}   infinity {100 * middle[2]:5.1f} / "
                f"{100 * high[2]:5.1f}"
            )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--rigs", type=int, default=30, help="random rigs a table")
    parser.add_argument("--data", type=Path, default=ROOT.parent / "shared" / "data" / "underwater", help="real pairs")
    arguments = parser.parse_args()
    cv2.setNumThreads(1)
    real(arguments.data)
    synthetic(arguments.rigs)
    prior(arguments.rigs)


if __name__ == "__main__":
    main()
