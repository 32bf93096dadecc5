"""Are the efforts in order, and is any peer better? Bad-1 of every pair, effort and tuned SGBM.

    python test/benchmark/match_efforts.py [--pairs six four simulated] [--methods ...]

The six small pairs, the four of Middlebury's first set, and simulated dives; mean errors in percent of the
non-occluded pixels, holes filled. A pair where a longer effort has over `SLACK` points more than a shorter one, or
where an effort has more than the best SGBM, is named behind its row. Needs ``../shared/data``.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from drowned_pairs import STEREO, THIRDS, Image, pairs
from held_out import scenes
from numpy.typing import NDArray
from peers import METHODS

from uw_recon_ros.evaluate import evaluate
from uw_recon_ros.match.methods import EFFORTS

SLACK = 0.2  #: points
OURS = [f"graph_cut {effort}" for effort in EFFORTS]
PEERS = ["SGBM 3WAY", "SGBM HH", "stereo_image_proc SGBM"]
Scene = tuple[str, Image, Image, NDArray[np.float32], NDArray[np.bool_], int]


def chosen(group: str) -> Iterator[Scene]:
    """Name, both views, true disparity, what counts, and labels."""
    if group == "simulated":
        for scene in scenes(drowned=False):
            labels = int(np.ceil(scene.truth[scene.seen].max())) + 3
            yield scene.name, scene.left, scene.right, scene.truth, scene.seen, labels
        return
    for truth in pairs(THIRDS if group == "six" else STEREO):
        yield truth.name, truth.left, truth.right, truth.disparity, truth.mask, truth.max_disparity


def out_of_order(bad: dict[str, float]) -> list[str]:
    """What is wrong with a row."""
    mine = [method for method in OURS if method in bad]
    worse = [
        f"{longer.split()[1]} over {shorter.split()[1]}"
        for shorter, longer in pairwise(mine)
        if bad[longer] > bad[shorter] + SLACK
    ]
    peers = [bad[method] for method in PEERS if method in bad]
    return worse + [f"{m.split()[1]} over SGBM" for m in mine if peers and bad[m] > min(peers)]


def main() -> int:
    """Print the table."""
    groups = ["six", "four", "simulated"]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", nargs="+", choices=groups, default=groups)
    parser.add_argument("--methods", nargs="+", choices=list(METHODS), default=OURS + PEERS)
    args = parser.parse_args()
    matchers = {method: METHODS[method](2) for method in args.methods}
    sys.stdout.write(f"| pair | {' | '.join(matchers)} | out of order |\n|{' --- |' * (len(matchers) + 2)}\n")
    for group in args.pairs:
        rows = []
        for name, left, right, truth, seen, labels in chosen(group):
            bad = {
                method: evaluate(matcher(left, right, labels).disparity, truth, seen).filled.bad_percent["bad-1"]
                for method, matcher in matchers.items()
            }
            rows.append(list(bad.values()))
            cells = " | ".join(f"{value:.2f}" for value in bad.values())
            sys.stdout.write(f"| {name} | {cells} | {', '.join(out_of_order(bad))} |\n")
            sys.stdout.flush()
        means = " | ".join(f"{value:.2f}" for value in np.mean(rows, axis=0))
        sys.stdout.write(f"| mean of {group} | {means} | |\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
