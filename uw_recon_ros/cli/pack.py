"""``uw_recon pack``: folders of stills to a bag."""

from __future__ import annotations

import argparse

from uw_recon_ros.cli.common import FAILED, OK, add_calibration, shown
from uw_recon_ros.progress import say

HELP = "convert image folders, videos or two cameras' bags to a bag"
DESCRIPTION = (
    "Convert image folders, videos or the bags of two cameras to one rosbag2 bag; stills are paired by times in "
    "their names or EXIF, by number, by order last."
)
EPILOG = (
    "Exit code: 0 every pair was packed; 1 some could not be, each is named and the rest is in the bag, or nothing "
    "could be done; 2 wrong usage. Images without a partner are named and are no failure."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what it takes."""
    parser.add_argument(
        "--left", required=True, metavar="GLOB", help="left images, quoted: 'left/*.png'; or a video, or a bag"
    )
    parser.add_argument("--right", required=True, metavar="GLOB", help="right ones: 'right/*.png'; a video, a bag")
    parser.add_argument("-o", "--output", required=True, metavar="BAG", help="folder of the bag to make")
    add_calibration(parser)
    parser.add_argument("--rate", type=float, default=2.0, metavar="HZ", help="pairs per second (default %(default)s)")


def run(args: argparse.Namespace) -> int:
    """Write the bag."""
    from uw_recon_ros.files.calibrations import read_calibration
    from uw_recon_ros.recordings.pack import pack

    calibration = read_calibration(args.calibration) if args.calibration else None
    packed = pack(
        args.left, args.right, args.output, calibration=calibration, rate_hz=args.rate, progress=shown("pairs")
    )
    for reason in packed.left_out:
        say(f"left out: {reason}")
    more = f", {len(packed.left_out)} LEFT OUT, see above" if packed.left_out else ""
    say(f"{args.output}: {packed.pairs} pairs{more}")
    return FAILED if packed.left_out else OK
