"""``uw_recon model``: one model of the dive out of a finished survey."""

from __future__ import annotations

import argparse
import json
import sys

from uw_recon_ros.blas import one_blas_thread
from uw_recon_ros.cli.common import OK, UsageError, add_params, given_params, warn
from uw_recon_ros.progress import say

HELP = "fuse a survey into one surface model with maps"
DESCRIPTION = (
    "Fuse a survey made with --write model into one model, in SURVEY_DIR/model/: trajectory, textured surface, maps."
)
EPILOG = "Exit code: 0 the model was made; 1 it was not, one line says why; 2 wrong usage; 70 internal error."


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what it takes."""
    from uw_recon_ros.model.params import DiveModelParams

    parser.add_argument("survey", metavar="SURVEY_DIR", help="folder that uw_recon survey filled")
    parser.add_argument(
        "--poses", metavar="FILE",
        help="poses of the left camera from outside: TUM, or CSV with a line of names (stamp, x, y, z, qx, qy, qz, qw; "
        "sigma_m, sigma_deg); another clock: --poses-offset-s",
    )  # fmt: skip
    parser.add_argument(
        "--bag", action="append", default=[], metavar="BAG",
        help="recording of the dive: its odometry, attitude, fixes and pressure are used; may be given several times",
    )  # fmt: skip
    parser.add_argument("--overwrite", action="store_true", help="make anew what SURVEY_DIR/model holds")
    parser.add_argument("--quiet", action="store_true", help="say nothing but errors")
    parser.add_argument("--json", action="store_true", help="write what model.json holds to standard output")
    add_params(parser, DiveModelParams.specs())


def run(args: argparse.Namespace) -> int:
    """Make the model, and say what came of it."""
    one_blas_thread()
    from uw_recon_ros.model.build import ModelRequest, build_model
    from uw_recon_ros.model.params import DiveModelParams

    try:
        params = DiveModelParams.from_mapping(given_params(args, DiveModelParams.specs()))
    except (TypeError, ValueError) as error:
        raise UsageError(str(error)) from error
    made = build_model(
        ModelRequest(args.survey, params, args.poses, args.overwrite, tuple(args.bag)),
        (lambda _: None) if args.quiet else say,
    )
    if args.json:
        sys.stdout.write(json.dumps(made) + "\n")
    if not args.quiet:
        warn(made["warnings"])
        first = made["models"][0]
        say(f"{args.survey}/model: {first['frames']} frames, {first['triangles']} triangles")
    return OK
