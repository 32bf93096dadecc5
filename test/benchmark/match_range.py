"""Does the automatic range of disparities hold the truth? In air and in water.

    python test/benchmark/match_range.py [--four] [--waters air clear hazy noisy uneven murk grain]

Six small pairs (or the four of Middlebury's first set): the range found, and the middle 99 % of the true disparities,
px; those that it misses are marked. Needs ``../shared/data``.
"""

from __future__ import annotations

import argparse
import sys

import numpy as np
from drowned_pairs import STEREO, THIRDS, WATERS, drown, pairs
from held_out import DROWNED

from uw_recon_ros.images import to_gray
from uw_recon_ros.match.disparity_range import find_disparity_range

ALL_WATERS = {**WATERS, **DROWNED}


def main() -> int:
    """Print the table; return how many are missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--four", action="store_true")
    parser.add_argument("--waters", nargs="+", choices=list(ALL_WATERS), default=list(ALL_WATERS))
    args = parser.parse_args()
    everything = list(pairs(STEREO if args.four else THIRDS))
    missed, widths = 0, []
    sys.stdout.write(f"| pair (truth) | {' | '.join(args.waters)} |\n|{' --- |' * (1 + len(args.waters))}\n")
    for truth in everything:
        least, greatest = np.percentile(truth.disparity[truth.mask], [0.5, 99.5])
        cells = []
        for water in args.waters:
            low, high = find_disparity_range(*(to_gray(view) for view in drown(truth, ALL_WATERS[water])))
            misses = low > least or high < greatest
            missed += misses
            widths.append((high - low) / (greatest - least))
            cells.append(f"{low} to {high}" + (" (missed)" if misses else ""))
        sys.stdout.write(f"| {truth.name} ({least:.1f} to {greatest:.1f}) | {' | '.join(cells)} |\n")
    sys.stdout.write(f"\nmissed: {missed} of {len(widths)}; as wide as the truth on the mean: {np.mean(widths):.2f}\n")
    return missed


if __name__ == "__main__":
    sys.exit(main())
