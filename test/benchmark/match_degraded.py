"""What blur, compression, exposure and water cost: bad-1 beside tuned SGBM.

    python test/benchmark/match_degraded.py [--four] [--ways ...] [--methods ...]

Six small pairs (or the four of Middlebury's first set): the right view blurred by 1 px; both views as JPEG of quality
30; both blurred along the depth, one camera more than the other (forward scatter); the right view darker, or of another
gamma; and four waters. Mean bad-1 in percent of the non-occluded pixels, holes filled; last, the errors of `balanced`
as a part of those of tuned SGBM HH. Needs ``../shared/data``.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable

import cv2
import numpy as np
from drowned_pairs import STEREO, THIRDS, WATERS, Image, Truth, drown, pairs
from matching import wet
from numpy.typing import NDArray
from peers import METHODS

from uw_recon_ros.evaluate import evaluate

JPEG_QUALITY, FEWEST_SIGMA, LEVELS = 30, 0.05, 8
Way = Callable[[Truth], tuple[Image, Image]]
OURS, PEER = "graph_cut balanced", "SGBM HH"


def _jpeg(image: Image) -> Image:
    _, packed = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return np.ascontiguousarray(cv2.imdecode(packed, cv2.IMREAD_COLOR)[..., ::-1])


def _scattered(image: Image, disparity: NDArray[np.float32], nearest: float, strength: float) -> Image:
    """Blurred by `strength` px at the nearest surface, and by the more the further away."""
    sigma = strength * nearest / np.maximum(disparity, 1)
    levels = np.linspace(FEWEST_SIGMA, max(float(sigma.max()), 2 * FEWEST_SIGMA), LEVELS)
    blurred = np.stack([cv2.GaussianBlur(image, (0, 0), float(level)).astype(np.float32) for level in levels])
    place = np.interp(sigma, levels, np.arange(LEVELS))
    below = np.minimum(place.astype(int), LEVELS - 2)
    part = (place - below)[..., None]
    v, u = np.indices(sigma.shape)
    return np.asarray(np.round(blurred[below, v, u] * (1 - part) + blurred[below + 1, v, u] * part), np.uint8)


def _both_scattered(truth: Truth) -> tuple[Image, Image]:
    nearest = float(np.percentile(truth.disparity_left, 99))
    return (
        _scattered(truth.left, truth.disparity_left, nearest, 0.4),
        _scattered(truth.right, truth.disparity_right, nearest, 0.8),
    )


def _toned(image: Image, curve: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> Image:
    return np.asarray(np.round(255 * curve(np.arange(256) / 255)), np.uint8)[image]


WAYS: dict[str, Way] = {
    "clean": lambda t: (t.left, t.right),
    "one blurred, 1 px": lambda t: (t.left, np.asarray(cv2.GaussianBlur(t.right, (0, 0), 1.0), np.uint8)),
    f"JPEG {JPEG_QUALITY}": lambda t: (_jpeg(t.left), _jpeg(t.right)),
    "scattered along depth": _both_scattered,
    "exposure x 0.6": lambda t: (t.left, _toned(t.right, lambda x: 0.6 * x)),
    "gamma 1.5": lambda t: (t.left, _toned(t.right, lambda x: x**1.5)),
    **{water: (lambda t, w=water: drown(t, WATERS[w])) for water in ("hazy", "noisy", "uneven")},
    "snow": lambda t: wet(t, "snow"),
}


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--four", action="store_true")
    parser.add_argument("--ways", nargs="+", choices=list(WAYS), default=list(WAYS))
    parser.add_argument("--methods", nargs="+", choices=list(METHODS), default=["graph_cut navigation", OURS, PEER])
    args = parser.parse_args()
    matchers = {method: METHODS[method](2) for method in args.methods}
    sys.stdout.write(f"| mean bad-1, % | {' | '.join(matchers)} | balanced / HH |\n|{' --- |' * (len(matchers) + 2)}\n")
    for way in args.ways:
        bad: dict[str, list[float]] = {method: [] for method in matchers}
        for truth in pairs(STEREO if args.four else THIRDS):
            left, right = WAYS[way](truth)
            for method, matcher in matchers.items():
                found = matcher(left, right, truth.max_disparity).disparity
                bad[method].append(evaluate(found, truth.disparity, truth.mask).filled.bad_percent["bad-1"])
        means = {method: float(np.mean(values)) for method, values in bad.items()}
        share = f"{means[OURS] / means[PEER]:.2f}" if {OURS, PEER} <= set(means) else "-"
        sys.stdout.write(f"| {way} | {' | '.join(f'{mean:.1f}' for mean in means.values())} | {share} |\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
