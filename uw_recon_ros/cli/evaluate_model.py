"""``uw_recon evaluate-model``: a model against the truth of a simulated dive."""

from __future__ import annotations

import argparse
import json
import sys

from uw_recon_ros.cli.common import OK
from uw_recon_ros.progress import say

HELP = "compare a dive's model with the ground truth"
DESCRIPTION = (
    "Errors of trajectory and surface against what uw_recon simulate --track ... --truth left: a table on standard "
    "error, JSON on standard output."
)
EPILOG = None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what it takes."""
    parser.add_argument("survey", metavar="SURVEY_DIR", help="folder with model/")
    parser.add_argument("truth", metavar="TRUTH_DIR", help="folder with trajectory.txt and surface.ply")


def run(args: argparse.Namespace) -> int:
    """Compare, and say how they differ."""
    from uw_recon_ros.model.evaluate import as_table, evaluate_model

    found = evaluate_model(args.survey, args.truth)
    say(as_table(found))
    sys.stdout.write(json.dumps(_plain(found), allow_nan=False) + "\n")
    return OK


def _plain(value: object) -> object:
    """Without NaN, which JSON does not have."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and value != value else value
