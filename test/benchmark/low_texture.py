"""What leaving out untextured_mask pixels does: bad-1 with and without it, holes left and holes filled.

    python test/benchmark/low_texture.py [--effort navigation]

Needs the Middlebury pairs of ``../shared/data``. In percent of the non-occluded pixels.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator

import numpy as np
from drowned_pairs import WATERS, Truth, drown, pairs

from uw_recon_ros.evaluate import evaluate
from uw_recon_ros.match.methods import EFFORTS
from uw_recon_ros.match.planes import matcher
from uw_recon_ros.match.planes.texture import Texture
from uw_recon_ros.types import Mask, Status

KEPT = ("air", "hazy", "noisy", "uneven")


def measure(truth: Truth, water: str, effort: str) -> list[float]:
    """Pixels left out, %, then bad-1 over what is left and with holes filled: all kept, untextured_mask left out."""
    left, right = drown(truth, WATERS[water])
    real, row = matcher.untextured_mask, []

    def nothing(texture: Texture) -> Mask:
        return np.zeros(texture.left.shape[:2], np.bool_)

    for rule in (nothing, real):
        matcher.untextured_mask = rule  # type: ignore[assignment]
        result = matcher.graph_cut(left, right, 0, truth.max_disparity - 1, effort=effort)
        errors = evaluate(result.disparity, truth.disparity, truth.mask)
        row += [errors.unfilled.bad_percent["bad-1"], errors.filled.bad_percent["bad-1"]]
        blank = (result.status == Status.LOW_TEXTURE)[truth.mask].mean()
    matcher.untextured_mask = real
    return [100 * float(blank), *row]


def table(effort: str) -> Iterator[str]:
    """Markdown, a row a pair and water, then the means."""
    yield "| pair | water | left out | bad-1 of the rest: all kept | left out | filled: all kept | left out |"
    yield "|" + " --- |" * 7
    everything = list(pairs())
    for water in KEPT:
        rows = [measure(truth, water, effort) for truth in everything]
        names = [truth.name for truth in everything] + ["mean"]
        for name, row in zip(names, [*rows, np.mean(rows, axis=0)], strict=True):
            out, rest_all, filled_all, rest, filled = row
            yield f"| {name} | {water} | {out:.1f} | {rest_all:.2f} | {rest:.2f} | {filled_all:.2f} | {filled:.2f} |"


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--effort", choices=EFFORTS, default="navigation")
    for line in table(parser.parse_args().effort):
        sys.stdout.write(line + "\n")
        sys.stdout.flush()
    return 0


if __name__ == "__main__":
    sys.exit(main())
