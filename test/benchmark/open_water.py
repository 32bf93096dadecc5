"""What is claimed where there is nothing but water, and what is lost where there is something.

    python test/benchmark/open_water.py [--efforts navigation balanced quality] [--waters I 3C 7C] [--without]
                                        [--underwater FOLDER]

Real: the canyon's and the diver's open water (rectangles of the raw left image, drawn by hand), and below them sand or
rock. Simulated: a rig that looks ahead, so that nearly half of its view is empty; water is what is further than
`VISIBLE_M` or meets nothing. In percent: pixels of the water with a disparity, with a depth after the depth filter, and
with one of less than half of the nearest surface's (real: of a thousandth of what is found on the ground); pixels of
surfaces with a disparity; simulated: the same where it is less than 1 px wrong, and what of them is more. `--without`
leaves the rules for open water out. The real pairs are folders of a left and a right image, in
``../shared/data/underwater`` or where `--underwater` says.
"""

from __future__ import annotations

import argparse
import dataclasses
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from drowned_pairs import STEREO, Image
from numpy.typing import NDArray

from uw_recon_ros.match.methods import EFFORTS
from uw_recon_ros.match.planes import matcher
from uw_recon_ros.match.planes.open_water import OpenWater
from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.preprocess.stage import Preprocess
from uw_recon_ros.reconstruct.stage import Reconstruct
from uw_recon_ros.rectify.stage import Rectify, RectifyParams
from uw_recon_ros.rectify.tracker import RigTracker
from uw_recon_ros.simulate import Dive, SimulateParams
from uw_recon_ros.types import Mask, RectifiedPair, StereoPair

UNDERWATER = STEREO.parent / "underwater"
VISIBLE_M = 12.0
#: Of the raw left images: rows and columns.
WATER = {
    "flsea_canyon": [np.s_[0:200, 700:1000]],
    "caddy_diver": [np.s_[10:380, 10:230], np.s_[10:360, 420:630]],
}
GROUND = {
    "flsea_canyon": [np.s_[560:700, 620:860], np.s_[300:700, 20:500], np.s_[450:700, 1000:1260]],
    "caddy_diver": [np.s_[220:470, 260:430]],
}


@dataclass(frozen=True, eq=False)
class View:
    """A rectified pair, what of its left view is water and what is ground, and the true disparity where known."""

    name: str
    pair: RectifiedPair
    water: Mask
    ground: Mask
    truth: NDArray[np.floating] | None = None


def real(folder: Path) -> View:
    """One of the shared underwater pairs."""
    name = folder.name
    left, right = (cv2.imread(str(next(folder.glob(f"{side}.*"))))[..., ::-1] for side in ("left", "right"))
    enhanced = Preprocess()(StereoPair(np.ascontiguousarray(left), np.ascontiguousarray(right)))
    rig = RigTracker(RectifyParams()).update(enhanced)
    drawn = [_drawn(left, places[name]) for places in (WATER, GROUND)]
    pair = Rectify(RectifyParams())(enhanced, rig)
    seen = [Rectify(RectifyParams())(dataclasses.replace(enhanced, left=d), rig).left[..., 0] > 250 for d in drawn]
    return View(name, pair, *seen)


def _drawn(image: Image, places: list[tuple[slice, slice]]) -> Image:
    mask = np.ones_like(image)
    for place in places:
        mask[place] = 255
    return mask


def simulated(water: str, **choice: object) -> View:
    """A dive's first pair over a flat bottom, so high an image that its upper part looks into open water."""
    frame = {"width": 240, "height": 400, "pitch_deg": 15.0, "distance_m": 1.5, "scene": "reef"}
    params = SimulateParams(water=water, **(frame | choice))  # type: ignore[arg-type]
    dive = Dive(params)
    taken = dive.frame(0)
    enhanced = Preprocess()(StereoPair(taken.left, taken.right, taken.stamp_ns, "left", dive.calibration))
    pair = Rectify(RectifyParams())(enhanced, RigTracker(RectifyParams()).update(enhanced))
    height, width = pair.left.shape[:2]
    depth = dive.true_depth(0, pair.geometry, width, height)
    seen, far = pair.left_matching > 0, ~(depth < VISIBLE_M)
    told = ", ".join((water, *(f"{k} {v}" for k, v in choice.items() if k not in ("width", "height"))))
    truth = pair.geometry.disparity_from_depth(depth)
    return View(f"simulated, {told}", pair, seen & _inner(far), seen & _inner(~far), truth)


def _inner(mask: Mask) -> Mask:
    """Without a rim."""
    return np.asarray(cv2.erode(mask.astype(np.uint8), np.ones((25, 25))) == 1)


def views(waters: list[str], underwater: Path) -> Iterator[View]:
    """All of them."""
    for name in WATER:
        if (underwater / name).is_dir():
            yield real(underwater / name)
    for water in waters:
        yield simulated(water)
    yield simulated("3C", lamp=0.0, daylight=2.0)
    yield simulated("3C", snow_per_m3=2500.0)
    yield simulated("3C", noise=4.0)
    yield simulated("3C", texture="weak")
    yield from behind_things()


def behind_things() -> Iterator[View]:
    """Blue water behind a wreck, the surface from below, lamps of others that blind the cameras."""
    day = {"width": 320, "height": 260, "lamp": 0.0, "daylight": 1.0}
    yield simulated("IB", scene="wreck", look_up_deg=12.0, **day)
    yield simulated("IB", surface_above=True, look_up_deg=28.0, water_depth_m=3.0, **day)
    yield simulated("IB", scene="wreck", surface_above=True, look_up_deg=30.0, **day)
    yield simulated("3C", other_lamps=3, look_up_deg=10.0, width=320, height=260)


COLUMNS = ("view (water, % of it)", "effort", "water: disparity", "water: depth", "water: near", "ground: disparity",
           "ground: right", "bad-1")  # fmt: skip


def measure(view: View, effort: str) -> list[float]:
    """The numbers of `COLUMNS`, percent."""
    disparity = Match(MatchParams(effort=effort))(view.pair)
    known = np.isfinite(disparity.disparity)
    depth = Reconstruct().depth(disparity).depth
    right = wrong = float("nan")
    surface = np.nanquantile(depth[view.ground], 0.001)
    if view.truth is not None:
        good = np.abs(disparity.disparity - view.truth) < 1
        right, wrong = _percent(good[view.ground]), _percent(~good[view.ground & known])
        surface = np.nanmin(view.pair.geometry.depth_from_disparity(view.truth)[view.ground])
    shares = [known[view.water], np.isfinite(depth)[view.water], depth[view.water] < surface / 2, known[view.ground]]
    return [*map(_percent, shares), right, wrong]


def _percent(mask: Mask) -> float:
    return 100 * float(mask.mean()) if mask.size else float("nan")


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--efforts", nargs="+", choices=EFFORTS, default=list(EFFORTS))
    parser.add_argument("--waters", nargs="+", default=["clear", "I", "3C", "5C", "7C"])
    parser.add_argument("--without", action="store_true")
    parser.add_argument("--things", action="store_true", help="only wreck, surface and lamps")
    parser.add_argument("--underwater", type=Path, default=UNDERWATER, help="folder of the real pairs")
    args = parser.parse_args()
    if args.without:
        matcher.open_water = lambda texture, *_: OpenWater(*np.zeros((2, *texture.left.shape[:2]), np.bool_))
        matcher.unfounded = lambda disparity, *_: np.zeros(disparity.shape, np.bool_)
    sys.stdout.write(f"| {' | '.join(COLUMNS)} |\n" + "|" + " --- |" * len(COLUMNS) + "\n")
    for view in behind_things() if args.things else views(args.waters, args.underwater):
        for effort in args.efforts:
            cells = " | ".join(f"{value:.1f}" for value in measure(view, effort))
            sys.stdout.write(f"| {view.name} ({100 * view.water.mean():.0f} %) | {effort} | {cells} |\n")
            sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
