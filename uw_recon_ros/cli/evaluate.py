"""``uw_recon evaluate``: a disparity map against the truth."""

from __future__ import annotations

import argparse
import json
import sys

from uw_recon_ros.cli.common import OK
from uw_recon_ros.errors import ReconError
from uw_recon_ros.progress import say

HELP = "compare a disparity map with the ground truth"
DESCRIPTION = (
    "Compare a disparity map with the ground truth: a table on standard error, JSON on standard output; bad-x is the "
    "share of pixels, in percent, "
    "whose error is over x px."
)
EPILOG = None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what it takes."""
    parser.add_argument("estimate", help="PFM or float TIFF; inf or NaN = invalid")
    parser.add_argument("truth", help="the same; inf = unknown")
    parser.add_argument("--mask", metavar="PNG", help="255 = count this pixel")


def run(args: argparse.Namespace) -> int:
    """Compare, and say how they differ."""
    from uw_recon_ros.evaluate import as_table, evaluate
    from uw_recon_ros.files.disparities import read_disparity
    from uw_recon_ros.files.images import read_image
    from uw_recon_ros.images import to_gray

    mask = to_gray(read_image(args.mask)) == 255 if args.mask else None
    estimate, truth = read_disparity(args.estimate), read_disparity(args.truth)
    try:
        result = evaluate(estimate, truth, mask)
    except ValueError as error:
        raise ReconError(f"{args.estimate}, {args.truth}: {error}") from error
    say(as_table(result))
    sys.stdout.write(json.dumps(result.as_dict()) + "\n")
    return OK
