"""How much of the relief a matcher leaves, and what the step below the pixel gives back: simulated dives, three frames.

python test/benchmark/flattened_relief.py [--effort navigation] [rich mud ...]

Slope: of the disparity's error on the true disparity within a frame; -0.03 is a relief that is three percent too flat,
which looks like a rig whose disparities are off by that share of their mean.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np
from dive_model import DIVES, OTHERS
from numpy.typing import NDArray

from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.match.subpixel import refine_below_a_pixel
from uw_recon_ros.preprocess.stage import Preprocess, PreprocessParams
from uw_recon_ros.rectify.stage import Rectify, RectifyParams
from uw_recon_ros.rectify.tracker import RigTracker
from uw_recon_ros.simulate import CourseParams, SimulateParams, SurveyDive
from uw_recon_ros.simulate.params import defaults_on
from uw_recon_ros.types import StereoPair

_FRAMES = (2, 9, 16)
Floats = NDArray[np.float32]


def judged(found: Floats, true: Floats) -> tuple[float, ...]:
    """Median and 95 % of the error, px; share beyond a pixel, %; slope."""
    error = (found - true)[np.isfinite(found) & np.isfinite(true)]
    near = np.abs(found - true) < 1.0
    about = true[near] - true[near].mean()
    slope = float((about * (found - true)[near]).sum() / (about**2).sum())
    size = np.abs(error)
    return float(np.median(size)), float(np.quantile(size, 0.95)), 100 * float((size > 1).mean()), slope


def rows(name: str, effort: str) -> list[tuple[float, ...]]:
    """What the matcher finds, and after the step."""
    course, params = (DIVES | OTHERS)[name]
    chosen = CourseParams(**course)
    dive = SurveyDive(SimulateParams.from_mapping(defaults_on(chosen.track) | params), chosen)
    preprocess, rectify, rig = Preprocess(PreprocessParams()), Rectify(RectifyParams()), RigTracker(RectifyParams())
    match, taken, before, after = Match(MatchParams(effort=effort)), list(dive.taken()), [], []
    for number in _FRAMES:
        shot = dive.frame(taken[number])
        enhanced = preprocess(StereoPair(shot.left, shot.right, stamp_ns=shot.stamp_ns, calibration=dive.calibration))
        pair = rectify(enhanced, rig.update(enhanced))
        found = match(pair)
        height, width = found.disparity.shape
        true = pair.geometry.disparity_from_depth(dive.true_depth(taken[number], pair.geometry, width, height))
        before.append(judged(found.disparity, true))
        after.append(judged(refine_below_a_pixel(pair.left, pair.right, found.disparity, found.sigma)[0], true))
    return [tuple(np.mean(part, axis=0)) for part in (before, after)]


def main() -> None:
    """Write the table to standard output."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--effort", default="navigation")
    parser.add_argument("dives", nargs="*", default=["rich", "mud"])
    args = parser.parse_args()
    sys.stdout.write(f"| {args.effort} | median / 95 %, px | over 1 px, % | slope |\n| --- | --- | --- | --- |\n")
    for name in args.dives:
        for label, (median, most, bad, slope) in zip(
            ("matcher", "below the pixel"), rows(name, args.effort), strict=True
        ):
            sys.stdout.write(f"| {name}, {label} | {median:.3f} / {most:.3f} | {bad:.2f} | {slope:+.4f} |\n")
            sys.stdout.flush()


if __name__ == "__main__":
    main()
