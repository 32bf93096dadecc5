"""``uw_recon measure``: lengths, heights and areas with their standard deviation."""

from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path

from uw_recon_ros.cli.common import OK, UsageError, warn
from uw_recon_ros.progress import say

HELP = "measure lengths, heights and areas, each with its error"
DESCRIPTION = (
    "Measure in the rectified left picture (left_rect.png) of a pair, or in a frame that a survey kept: a length along "
    "two or more points, the height of points above the bottom or above a plane, area and rugosity of "
    "a patch (its area over the area of its projection onto a plane)."
)
EPILOG = (
    "Example: uw_recon measure pair_out length 210,180 402,190. Exit code: 0 done, 1 no depth there, 2 wrong usage."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what it takes."""
    parser.add_argument("input", help="folder of pair, folder of survey --write model, or one kept frame")
    parser.add_argument("quantity", choices=("length", "height", "area"))
    parser.add_argument("points", nargs="+", metavar="U,V", help="pixels of the rectified left picture")
    parser.add_argument("--frame", default="", metavar="NAME", help="which frame, where the input is a survey")
    parser.add_argument("--plane", nargs="+", metavar="U,V", help="corners of the plane that heights are measured from")
    parser.add_argument(
        "--click-px",
        type=float,
        default=1.0,
        metavar="PX",
        help="standard deviation of a click, px (default %(default)s)",
    )
    parser.add_argument(
        "--calibration-report",
        metavar="FILE",
        help="calibration.json of calibrate: its covariance becomes part of every error",
    )
    parser.add_argument(
        "--known-length", nargs=3, metavar=("MM", "U,V", "U,V"),
        help="take the scale from a known length between two pixels instead of from the baseline",
    )  # fmt: skip
    parser.add_argument(
        "--known-sigma-mm", type=float, default=0.0, metavar="MM", help="standard deviation of that length"
    )
    parser.add_argument("-o", "--output", metavar="FILE", help=".json or .csv; else JSON on standard output")


def run(args: argparse.Namespace) -> int:
    """Measure, and say it."""
    from uw_recon_ros.measure_files import calibration_error, measure, open_frame, rows_of, scaled, write_rows

    points = _points(args.points)
    least = {"length": 2, "height": 1, "area": 3}[args.quantity]
    if len(points) < least:
        raise UsageError(f"{args.quantity}: expected {least} points or more, got {len(points)}")
    if args.output and Path(args.output).suffix.lower() not in (".json", ".csv"):
        raise UsageError(f"--output: expected a name that ends in .json or .csv, got {args.output}")
    if not 0 <= args.click_px <= 100:
        raise UsageError(f"--click-px: expected 0 to 100, got {args.click_px:g}")
    opened = open_frame(args.input, args.frame)
    error = calibration_error(args.calibration_report, opened) if args.calibration_report else opened.calibration
    if args.known_length:
        length, *bar = args.known_length
        opened, error = scaled(
            opened, _points(bar), _millimetres(length) / 1e3, args.known_sigma_mm / 1e3, args.click_px
        )
    plane = _points(args.plane) if args.plane else None
    results = measure(opened, args.quantity, points, plane=plane, click_px=args.click_px, calibration=error)
    rows = rows_of(opened, results)
    warn([finding.as_dict() for finding in opened.findings])
    for result in results:
        part = "" if error else " (without the calibration's part)"
        value = f"{result.value:.4g} ± {result.sigma:.2g} {result.unit}".rstrip()
        say(f"{result.quantity}: {value}{part}, at a depth of {result.depth:.3g} {opened.unit}")
    if args.output:
        write_rows(args.output, rows)
    else:
        sys.stdout.write(json.dumps(rows, indent=2, allow_nan=False) + "\n")
    return OK


def _points(words: list[str]) -> list[tuple[float, float]]:
    found = []
    for word in words:
        try:
            u, v = (float(part) for part in word.split(","))
        except ValueError as error:
            raise UsageError(f"point: expected U,V in px such as 210,180, got {word}") from error
        found.append((u, v))
    return found


def _millimetres(word: str) -> float:
    try:
        value = float(word)
    except ValueError as error:
        raise UsageError(f"--known-length: expected mm, got {word}") from error
    if not 0 < value < 1e6:
        raise UsageError(f"--known-length: expected > 0 mm, got {word}")
    return value
