"""How honest sigma is after the step below the pixel, and what its two constants were chosen by: simulated dives.

    python test/benchmark/corrected_sigma.py [--sweep]

68 and 95 % are honest. Three frames each of five dives that nothing else is measured on, pixels that the depth filter
left and that are within 1.5 px of the truth. Rows: the matcher alone, its sigma after the step, the sigma that belongs
to the step; for this one also the thirds of the pixels that are told to be the surest, middling, and least sure.
`--sweep` tries other constants: sum of the distances from 68 and 95 % over all dives, thirds counted a third each.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.match import subpixel
from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.preprocess.stage import Preprocess, PreprocessParams
from uw_recon_ros.reconstruct.stage import Reconstruct
from uw_recon_ros.rectify.stage import Rectify, RectifyParams
from uw_recon_ros.rectify.tracker import RigTracker
from uw_recon_ros.simulate import CourseParams, SimulateParams, SurveyDive
from uw_recon_ros.simulate.params import defaults_on
from uw_recon_ros.types import RectifiedPair, StereoPair

_SMALL = {"frames": 20, "width": 480, "height": 360}
_LEGS = {"track": "lawnmower", "leg_m": 1.2}
_SWING = {"track": "line", "bottom": "relief", "altitude_swing_m": 0.2}
_SNOW = {"texture": "weak", "water": "7C", "snow_per_m3": 1000.0}
#: Name: fields of `CourseParams`, of `SimulateParams`.
DIVES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "objects": (_LEGS, {"seed": 31, **_SMALL}),
    "relief": (_SWING, {"seed": 32, **_SMALL}),
    "mud, 7C, snow": (_LEGS, {"seed": 33, **_SNOW, **_SMALL}),
    "5C": ({"track": "line"}, {"seed": 34, "water": "5C", **_SMALL}),
    "weak texture": ({"track": "orbit"}, {"seed": 35, "texture": "weak", **_SMALL}),
}
_FRAMES = (2, 9, 16)
_NEAR_PX = 1.5
Floats = NDArray[np.floating[Any]]
Frame = tuple[RectifiedPair, Floats, Floats, Floats]


def frames(name: str, effort: str) -> Iterator[Frame]:
    """Pairs, disparity, sigma, true disparity."""
    course, params = DIVES[name]
    chosen = CourseParams(**course)
    dive = SurveyDive(SimulateParams.from_mapping(defaults_on(chosen.track) | params), chosen)
    preprocess, rectify, rig = Preprocess(PreprocessParams()), Rectify(RectifyParams()), RigTracker(RectifyParams())
    match, taken = Match(MatchParams(effort=effort)), list(dive.taken())
    for number in _FRAMES:
        shot = dive.frame(taken[number])
        enhanced = preprocess(StereoPair(shot.left, shot.right, stamp_ns=shot.stamp_ns, calibration=dive.calibration))
        pair = rectify(enhanced, rig.update(enhanced))
        found = match(pair)
        there = np.isfinite(Reconstruct().depth(found).depth)
        height, width = found.disparity.shape
        true = pair.geometry.disparity_from_depth(dive.true_depth(taken[number], pair.geometry, width, height))
        yield pair, np.where(there, found.disparity, np.nan), np.where(there, found.sigma, np.nan), true


def errors(seen: list[Frame], step: bool, own: bool) -> tuple[Floats, Floats]:
    """Size of the errors, and sigma; px."""
    missed, told = [], []
    for pair, before, sigma_before, true in seen:
        disparity, sigma = before, sigma_before
        if step:
            disparity, sigma = subpixel.refine_below_a_pixel(pair.left, pair.right, before, sigma_before)
        good = np.abs(before - true) < _NEAR_PX
        missed.append(np.abs(disparity - true)[good])
        told.append((sigma if own else sigma_before)[good])
    return np.concatenate(missed), np.concatenate(told)


def shares(missed: Floats, told: Floats) -> tuple[float, float, list[float]]:
    """Within one and two sigma, and within one by thirds of sigma; %."""
    order = np.array_split(np.argsort(told, kind="stable"), 3)
    return (
        100 * float((missed <= told).mean()), 100 * float((missed <= 2 * told).mean()),
        [100 * float((missed[third] <= told[third]).mean()) for third in order],
    )  # fmt: skip


def sweep(seen: dict[str, list[Frame]]) -> None:
    """Other constants."""
    for shape, least in itertools.product((2.0, 4.0, 6.0, 9.0), (0.0, 0.03, 0.04, 0.05, 0.06)):
        subpixel._SHAPE, subpixel._LEAST_SIGMA_PX = shape, least
        found = [shares(*errors(part, step=True, own=True)) for part in seen.values()]
        far = sum(abs(a - 68) + abs(b - 95) + sum(abs(c - 68) for c in thirds) / 3 for a, b, thirds in found)
        within = ", ".join(f"{a:.0f}" for a, _, _ in found)
        sys.stdout.write(f"| {shape:g} | {least:g} | {far:.0f} | {within} |\n")


def main() -> None:
    """Write the table to standard output."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--effort", default="navigation")
    parser.add_argument("--sweep", action="store_true")
    parser.add_argument("dives", nargs="*", default=list(DIVES))
    args = parser.parse_args()
    seen = {name: list(frames(name, args.effort)) for name in args.dives}
    say = sys.stdout.write
    say(
        "| dive | 68 % of errors under, px | median sigma, px | within 1 / 2 sigma | by thirds |\n"
        + "| --- " * 5
        + "|\n"
    )
    kinds = {"matcher": (False, True), "step, the matcher's sigma": (True, False), "step, its own sigma": (True, True)}
    for (name, part), (label, (step, own)) in itertools.product(seen.items(), kinds.items()):
        missed, told = errors(part, step, own)
        one, two, thirds = shares(missed, told)
        apart = " / ".join(f"{share:.0f}" for share in thirds)
        sizes = f"{np.quantile(missed, 0.68):.3f} | {np.median(told):.3f}"
        say(f"| {name}, {label} | {sizes} | {one:.0f} / {two:.0f} % | {apart} |\n")
    if args.sweep:
        say("\n| noise counted again | least sigma, px | off | within 1 sigma |\n" + "| --- " * 4 + "|\n")
        sweep(seen)


if __name__ == "__main__":
    main()
