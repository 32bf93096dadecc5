"""``uw_recon pair``: one image pair to disparity, cloud and mesh."""

from __future__ import annotations

import argparse
from typing import Any

from uw_recon_ros.cli.common import OK, add_calibration, pipeline_params, warn
from uw_recon_ros.progress import say

HELP = "reconstruct one image pair"
DESCRIPTION = "Reconstruct one stereo pair: enhance, rectify, match, and write depth, point cloud and mesh."
EPILOG = (
    "Exit code: 0 done, also where the pair is marked unreliable: the last line and report.json (reliable, warnings) "
    "say so; 1 failed, report.json says where (failed); 2 wrong usage; 70 internal error; 130 after Ctrl-C."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what it takes."""
    parser.add_argument("left", help="image of the left camera (the upper or lower one of a vertical rig)")
    parser.add_argument("right", help="image of the right camera")
    parser.add_argument("-o", "--output", required=True, metavar="DIR", help="folder to fill; index.html shows it all")
    add_calibration(parser)
    parser.add_argument("--params", metavar="FILE", help="ROS parameter file")
    parser.add_argument("--overwrite", action="store_true", help="replace files of an earlier run")


def run(args: argparse.Namespace) -> int:
    """Reconstruct the pair, and say what came of it."""
    from uw_recon_ros.pair import reconstruct_files

    report = reconstruct_files(
        args.left, args.right, args.output, pipeline_params(args), args.calibration, overwrite=args.overwrite
    )
    warn(report["warnings"])
    rectification, matching = report["rectification"], report["matching"]
    median = rectification["row_error_median_px"]
    say(
        f"{args.output}/index.html: vertical (epipolar) error {'not known' if median is None else f'{median:.2f} px'}, "
        f"density {matching['density']:.0%}, scale {report['scale']}{_distances(report)}"
        f"{'' if report['reliable'] else ', NOT RELIABLE: see the warnings'}"
    )
    return OK


def _distances(report: dict[str, Any]) -> str:
    """What a wrong unit would show in."""
    depth, baseline = report["depth"], report["geometry"]["baseline_m"]
    if depth is None or baseline is None:
        return ""
    return f" (baseline {abs(baseline):.3g} m, depths {depth['p5_m']:.3g} to {depth['p95_m']:.3g} m)"
