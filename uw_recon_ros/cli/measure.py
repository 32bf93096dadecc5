"""``uw_recon measure``: lengths, heights and areas with their standard deviation."""

from __future__ import annotations

import argparse
import json
import math
import sys
from pathlib import Path
from typing import Any

from uw_recon_ros.cli.common import OK, UsageError, warn
from uw_recon_ros.progress import say

HELP = "measure lengths, heights and areas, each with its error"
DESCRIPTION = (
    "Measure in the rectified left picture (left_rect.png) of a pair, or in a frame that a survey kept: a length along "
    "two or more points, the height of points above the bottom or above a plane, area and rugosity of "
    "a patch (its area over the area of its projection onto a plane). On the model of a dive (model/ of a survey): a "
    "length between points of its surface, and the distance of points from a plane through others."
)
EPILOG = (
    "Examples: uw_recon measure pair_out length 210,180 402,190; uw_recon measure survey_out/model length 0.1,0.4,-1.2 "
    "0.6,0.4,-1.1. Exit code: 0 done, 1 no depth there, 2 wrong usage."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what it takes."""
    parser.add_argument("input", help="folder of pair or of survey --write model, one kept frame, or a model")
    parser.add_argument("quantity", choices=("length", "height", "area"))
    parser.add_argument(
        "points", nargs="+", metavar="U,V", help="pixels of the rectified left picture; X,Y,Z of a model"
    )
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
        "--click-mm", type=float, metavar="MM",
        help="standard deviation of a point of a model, mm (default: a cell of its map)",
    )  # fmt: skip
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
    from uw_recon_ros.measure_files import is_model

    if args.output and Path(args.output).suffix.lower() not in (".json", ".csv"):
        raise UsageError(f"--output: expected a name that ends in .json or .csv, got {args.output}")
    return _on_model(args) if is_model(args.input) else _in_view(args)


def _in_view(args: argparse.Namespace) -> int:
    """Measure in a pair or a kept frame."""
    from uw_recon_ros.measure_files import calibration_error, measure, open_frame, rows_of, scaled

    if args.click_mm is not None:
        raise UsageError("--click-mm: expected with a model, got a picture: --click-px is for pictures")
    points = _points(args.points)
    least = {"length": 2, "height": 1, "area": 3}[args.quantity]
    if len(points) < least:
        raise UsageError(f"{args.quantity}: expected {least} points or more, got {len(points)}")
    if not 0 <= args.click_px <= 100:
        raise UsageError(f"--click-px: expected 0 to 100, got {args.click_px:g}")
    if args.plane and len(args.plane) < 3:
        raise UsageError(f"--plane: expected three corners or more, got {len(args.plane)}")
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
        edge = _edge(result.other, result.unit)
        say(f"{result.quantity}: {value}{part}, at a depth of {result.depth:.3g} {opened.unit}{edge}")
    return _told(args, rows)


def _on_model(args: argparse.Namespace) -> int:
    """Measure on the model of a dive."""
    from uw_recon_ros.measure_files import measure_on, model_rows, open_model

    unused = [f"--{name.replace('_', '-')}" for name in _OF_VIEWS if getattr(args, name)]
    if unused or args.quantity == "area":
        got = unused[0] if unused else "area: the model's area.tif and rugosity.tif have areas"
        raise UsageError(f"on a model: expected length or height --plane, got {got}")
    if args.quantity == "height" and len(args.plane or ()) < 3:
        raise UsageError("height on a model: expected --plane with three corners or more of the plane to measure from")
    if args.quantity == "length" and len(args.points) < 2:
        raise UsageError(f"length: expected 2 points or more, got {len(args.points)}")
    if args.click_mm is not None and not 0 <= args.click_mm <= 1e5:
        raise UsageError(f"--click-mm: expected 0 to 100000, got {args.click_mm:g}")
    opened = open_model(args.input)
    points, plane = _places(args.points), _places(args.plane) if args.plane else None
    click = None if args.click_mm is None else args.click_mm / 1e3
    results = measure_on(opened, args.quantity, points, plane=plane, click=click)
    warn([finding.as_dict() for finding in opened.findings])
    for result in results:
        part = "" if result.sigma_calibration >= 0 else " (without the calibration's part)"
        say(f"{result.quantity}: {result.value:.4g} ± {result.sigma:.2g} {opened.unit}{part}")
    return _told(args, model_rows(opened, results))


_OF_VIEWS = ("frame", "calibration_report", "known_length", "known_sigma_mm")


def _told(args: argparse.Namespace, rows: list[dict[str, Any]]) -> int:
    from uw_recon_ros.measure_files import write_rows

    if args.output:
        write_rows(args.output, rows)
    else:
        sys.stdout.write(json.dumps(rows, indent=2, allow_nan=False) + "\n")
    return OK


def _edge(other: float, unit: str) -> str:
    """What an end at an edge leaves open."""
    if not math.isfinite(other):
        return ""
    return f"; an end lies at an edge: {other:.4g} {unit} by the other surface seen within 3 px: click further inside"


def _points(words: list[str]) -> list[tuple[float, float]]:
    return [(u, v) for u, v in (_coordinates(word, 2, "U,V in px such as 210,180") for word in words)]


def _places(words: list[str]) -> list[tuple[float, float, float]]:
    form = "X,Y,Z of the model such as 0.1,0.4,-1.2"
    return [(x, y, z) for x, y, z in (_coordinates(word, 3, form) for word in words)]


def _coordinates(word: str, count: int, form: str) -> list[float]:
    try:
        found = [float(part) for part in word.split(",")]
    except ValueError as error:
        raise UsageError(f"point: expected {form}, got {word}") from error
    if len(found) != count or not all(map(math.isfinite, found)):
        raise UsageError(f"point: expected {form}, got {word}")
    return found


def _millimetres(word: str) -> float:
    try:
        value = float(word)
    except ValueError as error:
        raise UsageError(f"--known-length: expected mm, got {word}") from error
    if not 0 < value < 1e6:
        raise UsageError(f"--known-length: expected > 0 mm, got {word}")
    return value
