"""Ways to find the disparity at the ends of a length, beside each other: what `measure.endpoints` was chosen by.

``python test/benchmark/length_ends.py [--seeds 11 12] [--scenes amphora pipe reef wreck] [--distances 0.7 1.3 2.5]``:
lengths as in ``measure_lengths.py``, on views that it does not report. Printed for each way: all lengths; the share of
those with another surface within 3 px of an end (told as `other`), and the rest; the share within one sigma of the
disparity, and by what sigma would have to be multiplied to hold 68 %.
"""

from __future__ import annotations

import argparse
import itertools
import sys
from unittest.mock import patch

import numpy as np
from measure_lengths import Errors, errors_in, seen_by
from sigma_calibration import view_of

from uw_recon_ros.measure import endpoints

FAR = 1e9
WAYS = {
    "as it is": {"_STRAIGHT": endpoints._STRAIGHT},
    "a plane may go through two surfaces": {"_MOST_TOLERANCE_PX": FAR},
    "a line need not be seen at the end": {"_BORNE_PX": FAR},
    "no line": {"_STRAIGHT": FAR},
    "a plane of 17 px first": {"_SPOT_PX": (8, 2)},
    "a plane of 25 px first": {"_SPOT_PX": (12, 2)},
    "a plane of 5 px only": {"_SPOT_PX": (2, 2)},
    "what the segment shows": {"_SPOT_PX": (0, 0)},
}


def told(parts: list[Errors]) -> str:
    """A row of the table."""
    relative, over, edge = (np.concatenate([getattr(p, name) for p in parts]) for name in ("relative", "over", "edge"))
    errors, shares = 100 * np.abs(relative), np.abs(over)
    rest = errors[~edge]
    return (
        f"{sum(p.refused for p in parts)} | {errors.mean():.2f} | {np.quantile(errors, 0.95):.2f} | "
        f"{edge.mean():.1%} | "
        f"{rest.mean():.2f} | {np.quantile(rest, 0.95):.2f} | {np.mean(shares <= 1):.0%} | "
        f"{np.quantile(shares, 0.68):.2f} |\n"
    )


def main() -> None:
    """Print a table a distance."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--seeds", type=int, nargs="+", default=[11, 12])
    parser.add_argument("--scenes", nargs="+", default=["amphora", "pipe", "reef", "wreck"])
    parser.add_argument("--distances", type=float, nargs="+", default=[0.7, 1.3, 2.5])
    parser.add_argument("--width", type=int, default=480)
    parser.add_argument("--lengths", type=int, default=150)
    args = parser.parse_args()
    write, size = sys.stdout.write, {"width": args.width, "height": 3 * args.width // 4}
    for distance in args.distances:
        kinds = list(itertools.product(args.scenes, args.seeds))
        views = [view_of(scene=scene, distance_m=distance, seed=seed, **size) for scene, seed in kinds]
        seen = [(view, seen_by(view, "balanced")) for view in views]
        write(f"\n{distance:g} m, {args.width} px\n\n| way | refused | mean, % | 95 %, % | with another surface | ")
        write("others: mean, % | 95 %, % | within 1 sigma | factor |\n|" + " --- |" * 9 + "\n")
        for name, way in WAYS.items():
            with patch.multiple(endpoints, **way):
                parts = [errors_in(*pair, args.lengths, seed) for pair, (_, seed) in zip(seen, kinds, strict=True)]
            write(f"| {name} | " + told(parts))
            sys.stdout.flush()


if __name__ == "__main__":
    main()
