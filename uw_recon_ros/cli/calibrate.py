"""``uw_recon calibrate``: pictures of a board to the calibration of a rig."""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from uw_recon_ros.board_kinds import CHECKERBOARD, KINDS
from uw_recon_ros.cli.common import OK, UsageError, warn
from uw_recon_ros.lenses import AUTO, LENSES
from uw_recon_ros.progress import Progress, say

HELP = "calibrate a stereo rig with a board"
DESCRIPTION = (
    "Pairs of pictures of a board (stills, bags or videos, as survey takes them) to left.yaml, right.yaml, "
    "calibration.yaml (both, as --calibration takes it), calibration.json and a page that says what it is worth."
)
EPILOG = "Exit code: 0 done, also where the calibration is marked unreliable; 1 failed; 2 wrong usage."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what it takes."""
    parser.add_argument(
        "input", nargs="?", help="folder with the stills of both cameras (left/, right/), a bag, or videos"
    )
    parser.add_argument("-o", "--output", required=True, metavar="DIR", help="folder to fill; index.html shows it all")
    parser.add_argument("--board", choices=KINDS, default=CHECKERBOARD, help="kind of board (default %(default)s)")
    parser.add_argument(
        "--size", metavar="CxR",
        help="inner corners of a checkerboard (default: found), squares of ChArUco, tags, or circles: columns x rows",
    )  # fmt: skip
    parser.add_argument(
        "--square-mm", type=float, default=0.0, metavar="MM",
        help="side of a square, or from tag to tag, or from circle to circle; without it nothing is in metres",
    )  # fmt: skip
    parser.add_argument(
        "--marker-mm",
        type=float,
        default=0.0,
        metavar="MM",
        help="side of a marker (default: the usual share of a square)",
    )
    parser.add_argument(
        "--dictionary", default="", metavar="NAME", help="dictionary of the markers, e.g. DICT_5X5_250 (default: found)"
    )
    parser.add_argument(
        "--medium",
        choices=("water", "air", "unknown"),
        default="unknown",
        help="medium between camera housing and board",
    )
    parser.add_argument(
        "--lens", choices=LENSES, default=AUTO,
        help="model of both lenses: equidistant for a fisheye (default: the one that predicts held-out pairs better)",
    )  # fmt: skip
    parser.add_argument(
        "--air", metavar="FILE",
        help="calibration.json made in air: find the flat ports before its cameras, from these pictures in water",
    )  # fmt: skip
    parser.add_argument(
        "--port-thickness-mm", type=float, default=6.0, metavar="MM", help="of the pane, with --air (%(default)g)"
    )
    parser.add_argument(
        "--port-index", type=float, default=1.49, metavar="N", help="acrylic 1.49 (default), glass 1.52"
    )
    parser.add_argument(
        "--water-index", type=float, default=1.333, metavar="N", help="fresh 1.333 (default), sea 1.342"
    )
    parser.add_argument(
        "--most-pairs",
        type=int,
        default=150,
        metavar="N",
        help="pairs searched for the board at most, spread over the input (default %(default)s)",
    )
    parser.add_argument(
        "--live", action="store_true", help="gather pairs from running cameras (ROS 2) until Ctrl-C, then calibrate"
    )
    for side in ("left", "right"):
        parser.add_argument(
            f"--{side}-topic", default=f"{side}/image_raw", metavar="TOPIC", help="with --live (%(default)s)"
        )
    parser.add_argument("--overwrite", action="store_true", help="replace files of an earlier run")


def run(args: argparse.Namespace) -> int:
    """Calibrate, and say what came of it."""
    from uw_recon_ros.calibrate.ports import PortGlass
    from uw_recon_ros.calibrate_files import BoardAsked, PortsAsked, air_rig, calibrate_files

    if not 4 <= args.most_pairs <= 10_000:
        raise UsageError(f"--most-pairs: expected 4 to 10000, got {args.most_pairs}")
    if not (0 <= args.square_mm <= 1e4 and 0 <= args.marker_mm <= 1e4):
        raise UsageError(f"--square-mm, --marker-mm: expected 0 to 10000, got {args.square_mm:g}, {args.marker_mm:g}")
    if args.live:
        return _live(args)
    if args.input is None:
        raise UsageError("expected a folder, bag or video, or --live, got neither")
    glass = args.port_thickness_mm, args.port_index, args.water_index
    if not (0 <= glass[0] <= 200 and 1 <= glass[1] <= 2.5 and 1.2 <= glass[2] <= 1.5):
        raise UsageError(f"ports: expected a thickness of 0 to 200 mm and refractive indices, got {glass}")
    if args.air and (args.medium == "air" or not args.square_mm):
        raise UsageError("--air: expected pictures taken in water, with --square-mm")
    ports = PortsAsked(air_rig(args.air), PortGlass(glass[0] / 1e3, *glass[1:])) if args.air else None
    asked = BoardAsked(args.board, _size(args.size), args.square_mm / 1e3, args.marker_mm / 1e3, args.dictionary)
    report = calibrate_files(
        args.input, args.output, asked, medium=args.medium, most_pairs=args.most_pairs, ports=ports,
        lens=args.lens, overwrite=args.overwrite,
        progress=lambda frames: Progress().watch(frames, "pairs", len(frames)),
    )  # fmt: skip
    for out in report["left_out"]:
        say(f"left out: {out['name']}: {out['text']}")
    for note in report["notes"]:
        say(f"left out: {note}")
    warn([finding for finding in report["warnings"] if finding["severity"] != "ok"])
    for finding in report["warnings"]:
        if finding["severity"] == "ok":
            say(finding["text"])
    at_1_m = next((e["mean_percent"] for e in report["depth_errors"] if e["range_m"] == 1.0), None)
    depth = "not known" if at_1_m is None else f"{at_1_m:.2g} %"
    say(
        f"{args.output}/index.html: {len(report['pairs'])} pairs, reprojection error {report['rms_px']:.2f} px, depth "
        f"error at 1 m {depth}{'' if report['reliable'] else ', NOT RELIABLE: see the warnings'}"
    )
    return OK


def _live(args: argparse.Namespace) -> int:
    """Run the node with what was told; it writes at the end."""
    if args.input or args.air or args.lens != AUTO:
        raise UsageError("--live: expected no input, no --air and no --lens: pictures come from the topics")

    from uw_recon_ros.files.atomic import is_taken

    try:
        from uw_recon_ros.nodes.calibrate_node import main
    except ImportError as error:
        raise UsageError(
            f"--live: expected ROS 2, sourced or by pip install '.[ros-jazzy]' in the sources' folder; {error}"
        ) from error
    columns, rows = _size(args.size) or (0, 0)
    told = {
        "board": args.board, "board_columns": columns, "board_rows": rows, "board_square_mm": float(args.square_mm),
        "board_marker_mm": float(args.marker_mm), "board_dictionary": args.dictionary, "board_medium": args.medium,
        "calibration_dir": args.output, "calibration_pairs": args.most_pairs,
        "calibration_overwrite": str(args.overwrite).lower(),
    }  # fmt: skip
    words = [word for name, value in told.items() if value != "" for word in ("-p", f"{name}:={value}")]
    for side, topic in (("left", args.left_topic), ("right", args.right_topic)):
        for end in ("", "/compressed", "/ffmpeg", "/foxglove"):
            words += ["-r", f"{side}/image_raw{end}:={topic}{end}"]
    if is_taken(Path(args.output)) and not args.overwrite:
        raise UsageError(
            f"{args.output}: expected a new or empty folder, got one with files; --overwrite replaces them"
        )
    say("show the board to both cameras; Ctrl-C ends and calibrates; see /diagnostics and calibration/coverage")
    return main(["--ros-args", *words])


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    found = re.fullmatch(r"(\d{1,3})[xX](\d{1,3})", text)
    if not found:
        raise UsageError(f"--size: expected columns x rows such as 9x6, got {text}")
    return int(found[1]), int(found[2])
