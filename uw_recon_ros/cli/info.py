"""``uw_recon info``: whether a bag can be reconstructed."""

from __future__ import annotations

import argparse
import json
import sys

from uw_recon_ros.cli.common import FAILED, OK, UsageError
from uw_recon_ros.pairing import PAIR_TOLERANCE_MS

HELP = "check whether a bag can be reconstructed"
DESCRIPTION = "Check whether a bag can be reconstructed: topics, pairs, stamps, calibration, damage."
EPILOG = "Exit code: 0 it can be reconstructed, 1 it cannot, 2 wrong usage."
_LARGEST_TOLERANCE_MS = 1e3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what it takes."""
    parser.add_argument(
        "bag", metavar="BAG", help="rosbag2 bag (a folder, .mcap or .db3), a video, or a folder of stills"
    )
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the text")
    parser.add_argument(
        "--pair-tolerance-ms", type=float, default=PAIR_TOLERANCE_MS, metavar="MS",
        help="largest difference of stamps within a pair, as for survey (default %(default)s)",
    )  # fmt: skip
    parser.add_argument("--left-topic", metavar="TOPIC", help="left images (default: found by type and name)")
    parser.add_argument("--right-topic", metavar="TOPIC", help="right images (default: found by type and name)")
    parser.add_argument(
        "--images-rectified", choices=("auto", "yes", "no"), default="auto",
        help="whether the images come rectified already (default: by their topics' names)",
    )  # fmt: skip


def _is_bag(path: str) -> bool:
    """Whether it is to be judged as a bag: it is one, or nothing else."""
    from uw_recon_ros.errors import BagError
    from uw_recon_ros.recordings.sources import find_sources

    try:
        return all(source.kind == "bag" for source in find_sources([path]))
    except BagError:
        return True


def _show(args: argparse.Namespace) -> int:
    """What stills and videos hold; an error where there are no pairs."""
    from uw_recon_ros.recordings.options import Options
    from uw_recon_ros.recordings.recording import Recording

    with Recording(args.bag, Options(pair_tolerance_ms=args.pair_tolerance_ms)) as found:
        sys.stdout.write(f"{json.dumps(found.as_dict()) if args.json else found}\n")
    return OK


def run(args: argparse.Namespace) -> int:
    """Look at the bag, and say what it allows."""
    from uw_recon_ros.bags.info import bag_info

    if not 0 <= args.pair_tolerance_ms <= _LARGEST_TOLERANCE_MS:
        raise UsageError(
            f"--pair-tolerance-ms: expected 0 to {_LARGEST_TOLERANCE_MS:g}, got {args.pair_tolerance_ms:g}"
        )
    if not _is_bag(args.bag):
        return _show(args)
    found = bag_info(
        args.bag, args.left_topic, args.right_topic, tolerance_ns=round(args.pair_tolerance_ms * 1e6),
        images_rectified=args.images_rectified,
    )  # fmt: skip
    sys.stdout.write(f"{json.dumps(found.as_dict(), allow_nan=False) if args.json else found}\n")
    return OK if found.reconstructable else FAILED
