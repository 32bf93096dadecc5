"""Which profile should the matcher see? Disparity error over the kinds of water, for a matcher from outside or ours.

Usage: python test/benchmark/preprocess_profiles.py [--matcher sgbm|census|kz2|navigation|balanced|quality]

Each cell: bad-1 in percent over all non-occluded pixels, holes filled | over the pixels with a disparity @ density;
means over the four pairs. The default of `profile` is the row with the lowest error over the waters.
"""

# ruff: noqa: T201

from __future__ import annotations

import argparse
from collections.abc import Callable

import cv2
import numpy as np
from drowned_pairs import WATERS, drown, pairs
from numpy.typing import NDArray

from uw_recon_ros.evaluate import evaluate
from uw_recon_ros.preprocess.stage import Preprocess, PreprocessParams
from uw_recon_ros.types import RectificationQuality, RectifiedPair, StereoGeometry, StereoPair

Gray = NDArray[np.uint8]
Matcher = Callable[[Gray, Gray, int], NDArray[np.float32]]

_OFF = {"anisotropic_filtering": False}
TREATMENTS = {
    "none": PreprocessParams(profile="none"),
    "matching": PreprocessParams(profile="matching"),
    "matching, strength 0": PreprocessParams(profile="matching", matching_strength=0.0),
    "matching, strength 0.5": PreprocessParams(profile="matching", matching_strength=0.5),
    "matching, strength 1.5": PreprocessParams(profile="matching", matching_strength=1.5),
    "steps 1, 7": PreprocessParams(profile="paper", homomorphic_filtering=False, wavelet_denoising=False, **_OFF),
    "steps 1, 4, 7": PreprocessParams(profile="paper", wavelet_denoising=False, **_OFF),
    "steps 1, 4, 5, 7": PreprocessParams(profile="paper", **_OFF),
    "paper": PreprocessParams(profile="paper"),
}


def sgbm(left: Gray, right: Gray, labels: int) -> NDArray[np.float32]:
    """OpenCV's semi-global matcher, left border padded."""
    count = -(-labels // 16) * 16
    matcher = cv2.StereoSGBM_create(
        minDisparity=0, numDisparities=count, blockSize=3, P1=72, P2=288, disp12MaxDiff=1, uniquenessRatio=5,
        speckleWindowSize=50, speckleRange=2, preFilterCap=31, mode=cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    )  # fmt: skip
    padded = [np.pad(view, ((0, 0), (count, 0)), mode="edge") for view in (left, right)]
    disparity = matcher.compute(*padded)[:, count:].astype(np.float32) / 16
    return np.where(disparity >= 0, disparity, np.float32(np.nan))


def census(left: Gray, right: Gray, labels: int) -> NDArray[np.float32]:
    """The best census match of a 7 x 7 block, checked from the other camera: contrast does not matter to it."""
    signs = [_census(view) for view in (left, right)]
    cost = np.full((labels, *left.shape), 49.0, np.float32)
    other = cost.copy()
    for d in range(labels):
        stop = left.shape[1] - d
        differing = np.count_nonzero(signs[0][..., d:, :] != signs[1][..., :stop, :], axis=-1)
        cost[d, :, d:] = differing
        cost[d] = cv2.blur(cost[d], (7, 7))
        other[d, :, :stop] = cost[d, :, d:]
    best, back = cost.argmin(axis=0), other.argmin(axis=0)
    partner = np.clip(np.arange(left.shape[1]) - best, 0, None)
    agrees = np.abs(np.take_along_axis(back, partner, axis=1) - best) <= 1
    return np.where(agrees, best, np.nan).astype(np.float32)


def _census(image: Gray) -> NDArray[np.bool_]:
    padded = np.pad(image, 3, mode="edge")
    height, width = image.shape
    return np.stack([padded[v : v + height, u : u + width] < image for v in range(7) for u in range(7)], axis=-1)


def ours(name: str) -> Matcher:
    """The project's own matcher: kz2, or the default one at an effort."""
    from uw_recon_ros.match.stage import Match, MatchParams

    def match(left: Gray, right: Gray, labels: int) -> NDArray[np.float32]:
        choice = {"method": "kz2"} if name == "kz2" else {"effort": name}
        stage = Match(MatchParams(min_disparity=0, max_disparity=labels - 1, **choice))
        colors = [np.repeat(view[..., None], 3, axis=2) for view in (left, right)]
        geometry = StereoGeometry(1000.0, 0.0, 0.0, 0.0)
        return stage(RectifiedPair(*colors, left, right, geometry, RectificationQuality("given"))).disparity

    return match


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--matcher", default="sgbm", help="sgbm, census, kz2, or an effort of ours")
    name = parser.parse_args().matcher
    matcher = {"sgbm": sgbm, "census": census}.get(name) or ours(name)
    truths = list(pairs())
    print(f"{'bad-1, ' + name:24s}" + "".join(f"{water:>22s}" for water in WATERS) + f"{'waters':>9s}")
    for treatment, params in TREATMENTS.items():
        stage, row, errors = Preprocess(params), "", []
        for water in WATERS.values():
            found = []
            for truth in truths:
                out = stage(StereoPair(*drown(truth, water)))
                disparity = matcher(out.left_matching, out.right_matching, truth.max_disparity)
                found.append(evaluate(disparity, truth.disparity, truth.mask))
            filled = np.mean([e.filled.bad_percent["bad-1"] for e in found])
            unfilled = np.mean([e.unfilled.bad_percent["bad-1"] for e in found])
            row += f"{filled:8.1f} |{unfilled:5.1f} @{np.mean([e.density_percent for e in found]):4.0f} %"
            errors += [filled] if water else []
        print(f"{treatment:24s}{row}{np.mean(errors):9.1f}", flush=True)


if __name__ == "__main__":
    main()
