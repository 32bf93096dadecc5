"""Does the status find what one camera alone sees? Precision and recall of occlusions, per pair.

    python test/benchmark/match_occlusions.py [--four] [--efforts navigation balanced quality] [--seeds 1]

On six small pairs (or the four of Middlebury's first set). Called occluded is what the status calls seen by one camera
alone, outside the other view, or contradictory; truly occluded is what has a true disparity and is not in the mask of
pixels that both cameras see. Called so wrongly: share of the pixels that both see; missed: share of all; in percent.
Last, what one would get who called all pixels occluded that touch a truly occluded one: the truth is no sharper than
that. Needs ``../shared/data``.
"""

from __future__ import annotations

import argparse
import sys

import cv2
import numpy as np
from drowned_pairs import STEREO, THIRDS, Truth, pairs
from numpy.typing import NDArray

from uw_recon_ros.match.methods import EFFORTS
from uw_recon_ros.match.planes.matcher import graph_cut
from uw_recon_ros.types import ByteImage, Status

ONE_VIEW = Status.OCCLUDED | Status.OUTSIDE | Status.INCONSISTENT


def judged(called: NDArray[np.bool_], truth: Truth) -> list[float]:
    """Precision, recall, and the two shares in percent."""
    known = np.isfinite(truth.disparity)
    hidden = known & ~truth.mask
    called = known & called
    hits = float((called & hidden).sum())
    false, missed = (called & truth.mask).sum() / truth.mask.sum(), (hidden & ~called).sum() / known.sum()
    return [hits / max(called.sum(), 1), hits / max(hidden.sum(), 1), 100 * float(false), 100 * float(missed)]


def status(truth: Truth, effort: str, seed: int) -> ByteImage:
    """What the matcher says of each pixel."""
    return graph_cut(truth.left, truth.right, 0, truth.max_disparity - 1, effort=effort, seed=seed, threads=2).status


def blurred(truth: Truth) -> NDArray[np.bool_]:
    """The truth, a pixel wider."""
    hidden = np.isfinite(truth.disparity) & ~truth.mask
    return np.asarray(cv2.dilate(hidden.astype(np.uint8), np.ones((3, 3), np.uint8)) > 0)


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--four", action="store_true")
    parser.add_argument("--efforts", nargs="+", choices=EFFORTS, default=list(EFFORTS))
    parser.add_argument("--seeds", type=int, default=1)
    args = parser.parse_args()
    everything = list(pairs(STEREO if args.four else THIRDS))
    head = ("method", "pair", "precision", "recall", "called so wrongly, %", "missed, %")
    sys.stdout.write(f"| {' | '.join(head)} |\n|{' --- |' * len(head)}\n")
    for effort in [*args.efforts, "the truth, a pixel wider"]:
        rows = []
        for truth in everything:
            if effort in EFFORTS:
                found = [(status(truth, effort, seed) & ONE_VIEW) > 0 for seed in range(args.seeds)]
            else:
                found = [blurred(truth)]
            rows.append(np.mean([judged(called, truth) for called in found], axis=0))
        for name, row in zip([*(t.name for t in everything), "mean"], [*rows, np.mean(rows, axis=0)], strict=True):
            sys.stdout.write(f"| {effort} | {name} | {' | '.join(f'{x:.2f}' for x in row)} |\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
