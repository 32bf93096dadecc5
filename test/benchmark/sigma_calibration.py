"""How honest sigma is: the share of errors within it on simulated dives, by scene, water, effort and depth range.

    python test/benchmark/sigma_calibration.py [--scenes amphora reef] [--waters 3C 7C] [--efforts balanced] [--methods]

68 % is honest. Every dive goes through all stages with the true calibration; truth is cast anew for the rectified view.
Columns: pixels with a depth; gross errors (more than 3 px of disparity); the share within sigma of the disparities and
of the depths; the share of the depths nearer than, around, and beyond the middle third of the scene; and the factor
that would make sigma hold 68 % of the depths. `--methods` adds kz2, whose sigma is a constant.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.preprocess.stage import Preprocess
from uw_recon_ros.reconstruct.stage import Reconstruct
from uw_recon_ros.rectify.stage import Rectify, RectifyParams
from uw_recon_ros.rectify.tracker import RigTracker
from uw_recon_ros.simulate import Dive, SimulateParams
from uw_recon_ros.types import RectifiedPair, StereoPair

GROSS_PX = 3.0
SEED = 3
Floats = NDArray[np.floating[Any]]


@dataclass(frozen=True)
class View:
    """A rectified pair, and the true disparity and depth of its left view."""

    pair: RectifiedPair
    disparity: Floats
    depth: Floats


def view_of(frame: int = 0, **dive: Any) -> View:
    """Simulate a pair and rectify it."""
    simulated = Dive(SimulateParams(**dive))
    taken = simulated.frame(frame)
    enhanced = Preprocess()(StereoPair(taken.left, taken.right, taken.stamp_ns, "left", simulated.calibration))
    pair = Rectify(RectifyParams())(enhanced, RigTracker(RectifyParams()).update(enhanced))
    height, width = pair.left.shape[:2]
    depth = simulated.true_depth(frame, pair.geometry, width, height)
    return View(pair, pair.geometry.disparity_from_depth(depth), depth)


def measure(view: View, **match: Any) -> dict[str, float]:
    """Shares in percent; see the head of the file."""
    disparity = Match(MatchParams(**match))(view.pair)
    depth = Reconstruct().depth(disparity)
    known = np.isfinite(depth.depth) & np.isfinite(view.depth)
    error, truth = np.abs(depth.depth - view.depth)[known], view.depth[known]
    ratio = error / depth.sigma[known]
    shift = np.abs(view.pair.geometry.disparity_from_depth(depth.depth) - view.disparity)[known]
    near, far = np.quantile(truth, [1 / 3, 2 / 3])
    matched = np.isfinite(disparity.disparity) & np.isfinite(view.disparity)
    raw = (np.abs(disparity.disparity - view.disparity) / disparity.sigma)[matched]
    thirds = {"near": truth <= near, "middle": (truth > near) & (truth <= far), "far": truth > far}
    return {
        "density": 100 * float(known.mean()),
        "gross": 100 * float((shift > GROSS_PX).mean()),
        "error_px": float(np.quantile(shift, 0.68)),
        "disparity": 100 * float((raw <= 1).mean()),
        "depth": 100 * float((ratio <= 1).mean()),
        **{name: 100 * float((ratio[third] <= 1).mean()) for name, third in thirds.items()},
        "factor": float(np.quantile(ratio, 0.68)),
    }


HEAD = (
    "| scene | water | texture | rig | matcher | density % | gross % | 68 % of errors under, px | disparity % | depth %"
    " | near / middle / far % | factor |\n|" + " --- |" * 12
)


def row(names: tuple[str, ...], m: dict[str, float]) -> str:
    """One line of the table."""
    thirds = " / ".join(f"{m[name]:.0f}" for name in ("near", "middle", "far"))
    cells = (f"{m['density']:.0f}", f"{m['gross']:.1f}", f"{m['error_px']:.3f}", f"{m['disparity']:.0f}",
             f"{m['depth']:.0f}", thirds, f"{m['factor']:.2f}")  # fmt: skip
    return "| " + " | ".join((*names, *cells)) + " |"


def matchers(args: argparse.Namespace) -> list[dict[str, str]]:
    """What is measured."""
    chosen = [{"effort": effort} for effort in args.efforts]
    return chosen + ([{"method": "kz2"}] if args.methods else [])


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", nargs="+", default=["amphora", "pipe", "reef", "plane"])
    parser.add_argument("--waters", nargs="+", default=["clear", "I", "3C", "5C", "7C"])
    parser.add_argument("--textures", nargs="+", default=["rich"])
    parser.add_argument("--axes", nargs="+", default=["horizontal"])
    parser.add_argument("--efforts", nargs="+", default=["navigation", "balanced", "quality"])
    parser.add_argument("--methods", action="store_true")
    args = parser.parse_args()
    sys.stdout.write(HEAD + "\n")
    for scene, water, texture, axis in itertools.product(args.scenes, args.waters, args.textures, args.axes):
        view = view_of(scene=scene, water=water, texture=texture, axis=axis, seed=SEED)
        for choice in matchers(args):
            names = (scene, water, texture, axis, next(iter(choice.values())))
            sys.stdout.write(row(names, measure(view, **choice)) + "\n")
            sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
