"""The matchers on other scenes than the tuned ones: simulated dives with exact truth, and drownings anew.

The dives were looked at while changes were judged, so that none helped the four pairs alone; the drowned pairs, of
other seeds and strengths, were not.

    python test/benchmark/held_out.py [--methods ...]

Eight dives (rich and weak texture, slanted floors, noise, turbid water, particles, different exposure; other sizes than
the Middlebury pairs), and two Middlebury pairs under waters of other strength and seed than those of
``drowned_pairs.py``. Errors are bad-0.5 / bad-1 in percent of the pixels both cameras see, holes filled; CPU seconds.
"""

# ruff: noqa: T201

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from drowned_pairs import Image, Water, drown, pairs
from numpy.typing import NDArray
from peers import METHODS

from uw_recon_ros.evaluate import evaluate
from uw_recon_ros.simulate.dive import Dive
from uw_recon_ros.simulate.params import SimulateParams
from uw_recon_ros.types import CameraModel

DIVES: dict[str, dict[str, Any]] = {
    "amphora": {"scene": "amphora", "water": "3C", "seed": 11, "width": 520, "height": 400},
    "weak pipe": {"scene": "pipe", "water": "5C", "texture": "weak", "seed": 12, "width": 400, "height": 300,
                  "distance_m": 0.9},
    "noisy reef": {"scene": "reef", "water": "1C", "seed": 13, "width": 480, "height": 360, "noise": 4.0},
    "weak floor": {"scene": "plane", "water": "3C", "texture": "weak", "seed": 14, "width": 440, "height": 330,
                   "pitch_deg": 30.0, "distance_m": 1.0},
    "exposure": {"scene": "amphora", "water": "IA", "texture": "weak", "seed": 15, "width": 400, "height": 320,
                 "gain_difference": 0.35},
    "turbid reef": {"scene": "reef", "water": "3C", "seed": 16, "width": 440, "height": 320, "turbidity": 2.5,
                    "snow_per_m3": 1500.0, "pitch_deg": 30.0},
    "clear floor": {"scene": "plane", "water": "clear", "seed": 17, "width": 380, "height": 420, "pitch_deg": 22.0,
                    "mono": True, "snow_per_m3": 0.0},
    "snow": {"scene": "pipe", "water": "II", "seed": 18, "width": 420, "height": 315, "snow_per_m3": 4000.0,
             "gain_difference": -0.2, "noise": 2.0},
}  # fmt: skip
DROWNED = {
    "murk": Water((0.8, 0.6, 0.6), (0.9, 0.7, 0.7), (0.12, 0.45, 0.42), 0.35, 1.5),
    "grain": Water((0.5, 0.2, 0.25), (0.4, 0.25, 0.25), (0.05, 0.2, 0.22), 0.15, 5.0, gain=1.2, lamp=True),
}


@dataclass(frozen=True)
class Scene:
    """A rectified pair, the true disparity, NaN where unknown, and the pixels both cameras see."""

    name: str
    left: Image
    right: Image
    truth: NDArray[np.float32]
    seen: NDArray[np.bool_]


def scenes(drowned: bool = True) -> Iterator[Scene]:
    """All of them; without `drowned` or the Middlebury pairs, the dives alone."""
    for name, choice in DIVES.items():
        yield _dive(name, SimulateParams(misalignment_deg=0.0, distortion=0.0, frames=1, **choice))
    for pair in pairs() if drowned else ():
        if pair.name in ("venus", "cones"):
            for water, coefficients in DROWNED.items():
                yield Scene(f"{pair.name}, {water}", *drown(pair, coefficients, seed=7), pair.disparity, pair.mask)


def _dive(name: str, params: SimulateParams) -> Scene:
    """The cameras differ a little in focal length and centre: one affine map each rectifies them."""
    dive = Dive(params)
    frame, geometry = dive.frame(0), dive.geometry
    height, width = frame.depth.shape
    common = np.array(
        [[geometry.focal_px, 0, geometry.cx_left], [0, geometry.focal_px, geometry.cy], [0, 0, 1]], np.float64
    )

    def rectified(image: NDArray[Any], camera: CameraModel, how: int) -> Image:
        maps = cv2.initUndistortRectifyMap(camera.k, None, np.eye(3), common, (width, height), cv2.CV_32FC1)
        return np.asarray(cv2.remap(image, *maps, how, borderMode=cv2.BORDER_REPLICATE), np.uint8)

    cameras = dive.calibration.left, dive.calibration.right
    left, right = (rectified(i, c, cv2.INTER_CUBIC) for i, c in zip((frame.left, frame.right), cameras, strict=True))
    truth = dive.true_disparity(0, geometry, width, height)
    truth = np.where(np.isfinite(truth), truth, np.float32(np.nan)).astype(np.float32)
    hidden = rectified(frame.status, cameras[0], cv2.INTER_NEAREST) != 0
    return Scene(name, left, right, truth, np.isfinite(truth) & ~hidden)


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--methods", nargs="+", choices=list(METHODS), default=[
        "graph_cut navigation", "graph_cut balanced", "graph_cut quality", "SGBM 3WAY", "SGBM HH",
        "stereo_image_proc SGBM",
    ])  # fmt: skip
    methods = parser.parse_args().methods
    matchers = {method: METHODS[method](1) for method in methods}
    all_rows: list[list[tuple[float, float, float]]] = []
    print(f"| scene | {' | '.join(methods)} |\n|{' --- |' * (len(methods) + 1)}")
    for scene in scenes():
        labels = int(np.ceil(scene.truth[scene.seen].max())) + 3
        row = []
        for matcher in matchers.values():
            matcher(scene.left[:48, :64].copy(), scene.right[:48, :64].copy(), 8)  # compiled before it is timed
            before = time.process_time()
            disparity = matcher(scene.left, scene.right, labels).disparity
            spent = time.process_time() - before
            bad = evaluate(disparity, scene.truth, scene.seen).filled.bad_percent
            row.append((bad["bad-0.5"], bad["bad-1"], spent))
        all_rows.append(row)
        print(f"| {scene.name} | {' | '.join(f'{fine:.1f} / {bad:.1f}' for fine, bad, _ in row)} |", flush=True)
    means = np.mean(np.array(all_rows), axis=0)
    print(f"| mean | {' | '.join(f'{fine:.1f} / {bad:.1f}, {spent:.2f} s' for fine, bad, spent in means)} |")


if __name__ == "__main__":
    main()
