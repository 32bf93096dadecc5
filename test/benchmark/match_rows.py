"""What rows cost that are a little off: bad-1 with and without mending, and tuned SGBM.

    python test/benchmark/match_rows.py [--four] [--efforts navigation balanced]

The right view of six small pairs (or the four of Middlebury's first set) is lowered by 0.5, 1 and 2 px, and by fields
that change by 1.5 px over the image: turned, bent. Mean bad-1 in percent of the non-occluded pixels, holes filled; in
brackets the median residual row offset that is reported, and the greatest bad-1 of a pair over its clean one. Needs
``../shared/data``.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
from drowned_pairs import STEREO, THIRDS, Image, Truth, pairs
from numpy.typing import NDArray
from peers import GEOMETRY, METHODS

from uw_recon_ros.evaluate import evaluate
from uw_recon_ros.match.methods import EFFORTS
from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.types import RectificationQuality, RectifiedPair

Grid = NDArray[np.float32]
#: Of x and y from 0 to 1, px.
FIELDS: dict[str, Callable[[Grid, Grid], Grid]] = {
    "0": lambda x, y: 0 * x,
    "0.5": lambda x, y: 0.5 + 0 * x,
    "1": lambda x, y: 1 + 0 * x,
    "2": lambda x, y: 2 + 0 * x,
    "turned": lambda x, y: 1.5 * x,
    "bent": lambda x, y: 1.5 * (2 * y - 1) ** 2 * x,
}


def lowered(right: Image, field: str) -> Image:
    """The right view with its rows moved down; of no offset the very same."""
    if field == "0":
        return right
    height, width = right.shape[:2]
    v, u = np.indices((height, width), dtype=np.float32)
    rows = (v - FIELDS[field](u / (width - 1), v / (height - 1))).astype(np.float32)
    return np.asarray(cv2.remap(right, u, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE))


def ours(effort: str, mend: bool, truth: Truth, right: Image) -> tuple[float, float]:
    """Bad-1, %, and the residual row offset, px."""
    pair = RectifiedPair(truth.left, right, truth.left, right, GEOMETRY, RectificationQuality("given"))
    params = MatchParams(effort=effort, max_disparity=truth.max_disparity - 1, mend_rows=mend)
    found = Match(params)(pair)
    return _bad(found.disparity, truth), found.rows.median_px


def _bad(disparity: NDArray[np.floating[Any]], truth: Truth) -> float:
    return evaluate(disparity, truth.disparity, truth.mask).filled.bad_percent["bad-1"]


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--four", action="store_true")
    parser.add_argument("--efforts", nargs="+", choices=EFFORTS, default=["navigation", "balanced"])
    args = parser.parse_args()
    everything = list(pairs(STEREO if args.four else THIRDS))
    sys.stdout.write("| rows lower by, px | " + " | ".join(FIELDS) + " |\n|" + " --- |" * (1 + len(FIELDS)) + "\n")
    peer = METHODS["SGBM HH"](2)
    for name, method in [
        *((f"{e}, rows mended", lambda t, r, e=e: ours(e, True, t, r)) for e in args.efforts),
        *((f"{e}, as they are", lambda t, r, e=e: ours(e, False, t, r)) for e in args.efforts),
        ("SGBM HH, tuned", lambda t, r: (_bad(peer(t.left, r, t.max_disparity).disparity, t), float("nan"))),
    ]:
        cells, clean = [], np.zeros(len(everything))
        for field in FIELDS:
            bad, offset = np.array([method(truth, lowered(truth.right, field)) for truth in everything]).T
            clean = bad if field == "0" else clean
            told = "" if np.isnan(offset).all() else f"{np.nanmedian(offset):.2f} px; "
            cells.append(f"{bad.mean():.1f} ({told}{(bad / clean).max():.2f})")
        sys.stdout.write(f"| {name} | {' | '.join(cells)} |\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
