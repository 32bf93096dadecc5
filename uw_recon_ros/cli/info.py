"""``uw_recon info``: whether a recording can be reconstructed."""

from __future__ import annotations

import argparse
import json
import sys
from typing import TYPE_CHECKING

from uw_recon_ros.cli.common import FAILED, OK, UsageError, add_calibration
from uw_recon_ros.pairing import PAIR_TOLERANCE_MS

if TYPE_CHECKING:
    from uw_recon_ros.types import StereoPair

HELP = "check whether a recording can be reconstructed"
DESCRIPTION = (
    "Check whether a bag, a video or a folder of stills can be reconstructed: topics or files, pairs, stamps, "
    "calibration, damage."
)
EPILOG = "Exit code: 0 it can be reconstructed, 1 it cannot, 2 wrong usage."
_LARGEST_TOLERANCE_MS = 1e3
_LAYOUTS = ("auto", "separate", "side-by-side", "top-bottom", "row-interleaved", "mpo")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what it takes."""
    parser.add_argument(
        "inputs", nargs="+", metavar="BAG",
        help="rosbag2 bag (a folder, .mcap or .db3), a video, or a folder of stills; two videos, two bags or two "
        "folders of one camera each are a left and a right one",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the text")
    parser.add_argument(
        "--pair-tolerance-ms", type=float, default=PAIR_TOLERANCE_MS, metavar="MS",
        help="largest difference of stamps within a pair, as for survey (default %(default)s)",
    )  # fmt: skip
    parser.add_argument("--left-topic", default="", metavar="TOPIC", help="left images (default: by type and name)")
    parser.add_argument("--right-topic", default="", metavar="TOPIC", help="right images (default: by type and name)")
    parser.add_argument(
        "--layout", choices=_LAYOUTS, default="auto",
        help="how both views lie in one image of stills and videos (default: found)",
    )  # fmt: skip
    parser.add_argument(
        "--clock-offset", default="auto", metavar="S",
        help="seconds that the right camera's clock is ahead, as for survey (default %(default)s)",
    )  # fmt: skip
    parser.add_argument(
        "--images-rectified", choices=("auto", "yes", "no"), default="auto",
        help="whether the images come rectified already (default: by their topics' names)",
    )  # fmt: skip
    add_calibration(parser)


def _judge_pair(pair: StereoPair, images_rectified: str) -> str:
    """Whether a camera is upside down, the cameras are exchanged, or the same."""
    from uw_recon_ros.errors import ReconError
    from uw_recon_ros.findings import Code
    from uw_recon_ros.images import as_gray
    from uw_recon_ros.rectify.params import RectifyParams
    from uw_recon_ros.rectify.tracker import RigTracker
    from uw_recon_ros.types import EnhancedPair

    left, right = as_gray(pair.left), as_gray(pair.right)
    shown = EnhancedPair(left, right, left, right, pair.stamp_ns, pair.frame_id, pair.calibration)
    try:
        RigTracker(RectifyParams(images_rectified=images_rectified)).update(shown)
    except ReconError as error:
        if error.code in (Code.RECTIFY_UPSIDE_DOWN, Code.RECTIFY_EXCHANGED, Code.IMAGE_IDENTICAL):
            return str(error)
    return ""


def run(args: argparse.Namespace) -> int:
    """Look at the recording, and say what it allows."""
    from functools import partial

    from uw_recon_ros.files.calibrations import read_calibration
    from uw_recon_ros.recordings.info import inspect_recording
    from uw_recon_ros.recordings.listing import first_size
    from uw_recon_ros.recordings.options import Options, is_clock_offset
    from uw_recon_ros.recordings.sources import find_sources

    if not 0 <= args.pair_tolerance_ms <= _LARGEST_TOLERANCE_MS:
        raise UsageError(
            f"--pair-tolerance-ms: expected 0 to {_LARGEST_TOLERANCE_MS:g}, got {args.pair_tolerance_ms:g}"
        )
    if not is_clock_offset(args.clock_offset):
        raise UsageError(f"--clock-offset: expected auto or a number of seconds, got {args.clock_offset[:40]!r}")
    options = Options(
        args.left_topic, args.right_topic, args.pair_tolerance_ms, layout=args.layout, clock_offset=args.clock_offset
    )
    size = partial(first_size, find_sources(args.inputs), options)
    given = read_calibration(args.calibration, size) if args.calibration else None
    judge_pair = partial(_judge_pair, images_rectified=args.images_rectified)
    found = inspect_recording(args.inputs, options, given, args.images_rectified, judge_pair)
    fine = all(info.reconstructable for info in found)
    if args.json:
        each = [info.as_dict() for info in found]
        shown = each[0] if len(each) == 1 else {"recordings": each, "reconstructable": fine}
        sys.stdout.write(json.dumps(shown, allow_nan=False) + "\n")
    else:
        sys.stdout.write("\n\n".join(map(str, found)) + "\n")
    return OK if fine else FAILED
