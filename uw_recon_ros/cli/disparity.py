"""``uw_recon disparity``: an already rectified pair to a disparity map."""

from __future__ import annotations

import argparse
import json
import sys

from uw_recon_ros.cli.common import OK, pipeline_params, warn
from uw_recon_ros.match.methods import EFFORTS, METHODS

HELP = "match a rectified image pair: a disparity map"
DESCRIPTION = "Compute the disparity map of two rectified images; a summary as JSON on standard output."
EPILOG = None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what it takes."""
    parser.add_argument("left", help="rectified image of the left camera")
    parser.add_argument("right", help="rectified image of the right camera")
    parser.add_argument(
        "-o", "--output", required=True, metavar="FILE", help=".pfm (invalid = inf), .tiff (float32, invalid = NaN) "
        "or .png (16 bits, 256 times the disparity, invalid = 0)",
    )  # fmt: skip
    parser.add_argument("--overwrite", action="store_true", help="replace the file if there is one")
    parser.add_argument(
        "--max-disparity",
        type=int,
        metavar="N",
        help="largest disparity searched, inclusive, px; default: found from the images",
    )
    parser.add_argument("--min-disparity", type=int, metavar="N", help="smallest disparity searched, inclusive, px")
    parser.add_argument("--method", choices=METHODS, help="default: the first, or what the parameter file says")
    parser.add_argument(
        "--effort",
        choices=EFFORTS,
        help="speed of graph_cut: navigation takes a tenth of a second for 640x480 pixels and makes no cut; balanced "
        "(the default) cuts, in about a second; quality cuts until little moves any more, in many seconds",
    )
    parser.add_argument("--params", metavar="FILE", help="ROS parameter file")


def run(args: argparse.Namespace) -> int:
    """Match the pair; the numbers as JSON."""
    from uw_recon_ros.pair import match_files

    names = ("min_disparity", "max_disparity", "method", "effort")
    params = pipeline_params(args, **{name: getattr(args, name) for name in names})
    report = match_files(args.left, args.right, args.output, params.match, overwrite=args.overwrite)
    warn(report["warnings"])
    sys.stdout.write(json.dumps(report) + "\n")
    return OK
