"""``uw_recon convert-calibration``: a rig's calibration from any form to another."""

from __future__ import annotations

import argparse
import math
import re

from uw_recon_ros.cli.common import OK, UsageError
from uw_recon_ros.progress import say

HELP = "convert a stereo calibration to another file format"
DESCRIPTION = (
    "Read a calibration in any form (ROS, ost.txt, topic echo, kalibr, EuRoC, OpenCV, VIAME, ZED, MATLAB, KITTI, "
    "COLMAP), judge it, and write it."
)
EPILOG = "Exit code: 0 written; 1 it cannot be read, cannot be true, or the form cannot hold it; 2 wrong usage."
FORMS = ("ros", "opencv", "kalibr", "viame", "colmap")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what it takes."""
    parser.add_argument("calibration", nargs="+", metavar="FILE", help="a file, a folder, a tarball; or left and right")
    parser.add_argument("-o", "--output", required=True, metavar="FILE")
    parser.add_argument("--form", choices=FORMS, default="ros", help="form to write (default %(default)s)")
    parser.add_argument(
        "--size", type=_size, metavar="WxH", help="image size: where the file does not say, or to scale to"
    )
    parser.add_argument("--unit", choices=("m", "cm", "mm", "in"), help="unit of lengths, where the file does not say")


def _size(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"(\d{1,5})x(\d{1,5})", text)
    if found is None or "0" in (found[1], found[2]):
        raise argparse.ArgumentTypeError(f"expected WIDTHxHEIGHT in px, e.g. 1920x1080, got {text[:40]!r}")
    return int(found[1]), int(found[2])


def run(args: argparse.Namespace) -> int:
    """Convert, and say what was found."""
    from uw_recon_ros.calibration import scaled
    from uw_recon_ros.calibration.judge import judge_calibration
    from uw_recon_ros.files.calibrations import read_calibration, write_calibration

    if len(args.calibration) > 2:
        raise UsageError(f"expected one or two files, got {len(args.calibration)}")
    rig = read_calibration(args.calibration, args.size, args.unit)
    told = rig.left.width, rig.left.height
    if args.size and told != args.size:
        rig = scaled(rig, args.size)
        say(f"scaled from {told[0]}x{told[1]} to {args.size[0]}x{args.size[1]} px")
    judgement = judge_calibration(rig)
    judgement.raise_refused()
    for finding in judgement.findings:
        say(f"warning: {finding}")
    write_calibration(rig, args.output, args.form)
    baseline = abs(judgement.baseline_m)
    rest = "no baseline: two single cameras" if math.isnan(baseline) else f"baseline {baseline:.4f} m"
    say(f"{args.output}: {rig.left.width}x{rig.left.height} px, {rest}")
    return OK
