"""Is there more texture after the nine steps? SIFT matches that one epipolar geometry explains, on real water.

Usage: python test/benchmark/preprocess_matches.py

Columns: keypoints left, matches that pass the ratio test, those within 1 px of their epipolar line, their median
distance from it. The default of `homomorphic_cutoff` comes from here.
"""

# ruff: noqa: T201

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.preprocess.stage import Preprocess, PreprocessParams
from uw_recon_ros.types import StereoPair

WATER = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "underwater"
VARIANTS: dict[str, dict[str, float | bool]] = {
    **{f"cutoff {cutoff:g}": {"homomorphic_cutoff": cutoff} for cutoff in (2.0, 4.0, 8.0, 16.0, 32.0, 64.0)},
    "no step 4": {"homomorphic_filtering": False},
    "no step 5": {"wavelet_denoising": False},
    "no step 6": {"anisotropic_filtering": False},
    "step 6 ten times": {"diffusion_iterations": 10},
    "clip 0.3 %": {"intensity_clip": 0.3},
    "clip 3 %": {"intensity_clip": 3.0},
}


def verified(left: NDArray[np.uint8], right: NDArray[np.uint8]) -> str:
    """Keypoints, matches, verified matches, their median epipolar distance."""
    finder = cv2.SIFT_create(8000)
    points, words = zip(
        *(finder.detectAndCompute(cv2.cvtColor(view, cv2.COLOR_RGB2GRAY), None) for view in (left, right)), strict=True
    )
    pairs = cv2.BFMatcher().knnMatch(*words, k=2)
    good = [best for best, second in pairs if best.distance < 0.8 * second.distance]
    ends = [np.array([points[k][(m.queryIdx, m.trainIdx)[k]].pt for m in good]) for k in (0, 1)]
    fundamental, inlier = cv2.findFundamentalMat(*ends, cv2.USAC_MAGSAC, 1.0, 0.9999, 20000)
    x, y = (np.c_[end, np.ones(len(end))][inlier.ravel() > 0] for end in ends)
    lines = x @ fundamental.T
    distance = np.abs((lines * y).sum(axis=1)) / np.hypot(lines[:, 0], lines[:, 1])
    return f"{len(points[0]):8d}{len(good):8d}{len(x):8d}{np.median(distance):8.2f} px"


def main() -> None:
    """Print a table for each pair."""
    for path in sorted(WATER.glob("*/left.*")):
        pair = StereoPair(*(cv2.imread(str(path.with_stem(view)))[..., ::-1] for view in ("left", "right")))
        print(f"{path.parent.name}\n{'  raw':24s}{verified(pair.left, pair.right)}")
        for name, values in VARIANTS.items():
            out = Preprocess(PreprocessParams(**values))(pair)  # type: ignore[arg-type]
            print(f"{'  ' + name:24s}{verified(out.left, out.right)}", flush=True)


if __name__ == "__main__":
    main()
