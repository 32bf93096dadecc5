"""``uw_recon survey``: whole recordings, offline and resumable."""

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import sys
from typing import TYPE_CHECKING

from uw_recon_ros import stop_signals
from uw_recon_ros.blas import one_blas_thread
from uw_recon_ros.cli.common import (
    FAILED,
    OK,
    UsageError,
    add_calibration,
    add_params,
    given_params,
    pipeline_params,
    warn,
)
from uw_recon_ros.progress import say

if TYPE_CHECKING:
    from uw_recon_ros.survey.executor import Executor
    from uw_recon_ros.survey.job import Outcome
    from uw_recon_ros.survey.params import SurveyParams

HELP = "reconstruct whole recordings, offline and resumable"
DESCRIPTION = "Reconstruct every stereo pair of bags (or folders of stills) into a folder; report.html shows it."
EPILOG = (
    "Exit code: 0 every chosen pair was reconstructed; 1 some were not (frames.csv says which and why), an input could "
    "not be read, or nothing could be done; 2 wrong usage; 70 internal error; 130 after Ctrl-C. Unreliable frames "
    "count as reconstructed: the last line and frames.csv name them. Killed or interrupted, the same command goes on "
    "where it stood."
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what it takes."""
    from uw_recon_ros.survey.params import SurveyParams

    parser.add_argument(
        "inputs", nargs="+", metavar="BAG", help="bags, folders of bags, or folders of images with left/ and right/"
    )
    parser.add_argument("-o", "--output", required=True, metavar="DIR", help="folder to fill, or to go on with")
    parser.add_argument("--params", metavar="FILE", help="ROS parameter file")
    add_calibration(parser)
    parser.add_argument(
        "--overwrite", action="store_true", help="start over: remove the results of an earlier survey in DIR"
    )
    workers = parser.add_mutually_exclusive_group()
    workers.add_argument("--jobs", type=_positive, metavar="N", help="local processes (default: all cores)")
    workers.add_argument("--dask", metavar="ADDRESS", help="scheduler of a Dask cluster, e.g. tcp://10.0.0.1:8786")
    telling = parser.add_mutually_exclusive_group()
    telling.add_argument("--quiet", action="store_true", help="say nothing but errors")
    telling.add_argument(
        "--json", action="store_true", help="the outcome as one JSON object on stdout, progress as JSON lines on stderr"
    )
    parser.add_argument("--model", action="store_true", help="then make DIR/model, as uw_recon model does")
    add_params(parser, SurveyParams.specs())


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"expected >= 1, got {value}")
    return value


def run(args: argparse.Namespace) -> int:
    """Reconstruct, and say what came of it."""
    one_blas_thread()
    from uw_recon_ros.progress import Progress
    from uw_recon_ros.survey.job import SurveyRequest
    from uw_recon_ros.survey.run import run_survey

    try:
        survey_params = _survey_params(args)
    except (TypeError, ValueError) as error:
        raise UsageError(str(error)) from error
    request = SurveyRequest(
        args.inputs, args.output, pipeline_params(args), survey_params, tuple(args.calibration or ()), args.overwrite
    )
    progress = Progress("quiet" if args.quiet else "json" if args.json else "people")
    try:
        outcome = run_survey(request, lambda: _executor(args), progress)
    except KeyboardInterrupt:
        stop_signals.tell_interrupted(f"{args.output}: interrupted; the same command resumes there")
        return stop_signals.INTERRUPTED
    _tell(outcome, args)
    if args.model:
        _model(args)
    return OK if outcome.complete else FAILED


def _survey_params(args: argparse.Namespace) -> SurveyParams:
    from uw_recon_ros.survey.params import SurveyParams

    params = SurveyParams.from_mapping(given_params(args, SurveyParams.specs()))
    if args.model and "model" not in params.products:
        return dataclasses.replace(params, write=f"{params.write},model")
    return params


def _model(args: argparse.Namespace) -> None:
    """The model of what was surveyed, unless it is there."""
    from uw_recon_ros.model.build import ModelRequest, build_model, is_built
    from uw_recon_ros.model.params import DiveModelParams
    from uw_recon_ros.recordings.sources import find_sources

    if is_built(args.output):
        return
    tell = (lambda _: None) if args.quiet or args.json else say
    found = [source for source in find_sources(args.inputs) if source.kind == "bag"]
    bags = tuple(path for source in found for path in (source.path, source.other) if path)
    made = build_model(ModelRequest(args.output, DiveModelParams(), bags=bags), tell)
    if not args.quiet:
        warn(made["warnings"])


def _executor(args: argparse.Namespace) -> Executor:
    if args.dask:
        from uw_recon_ros.survey.executor import DaskExecutor

        return DaskExecutor(args.dask)
    from uw_recon_ros.survey.executor import LocalExecutor

    return LocalExecutor(args.jobs or available_cores())


def available_cores() -> int:
    """Cores this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def _tell(outcome: Outcome, args: argparse.Namespace) -> None:
    if args.json:
        sys.stdout.write(json.dumps(dataclasses.asdict(outcome)) + "\n")
    elif not args.quiet:
        new = outcome.frames - outcome.resumed
        say(
            f"{outcome.output}/report.html: {outcome.ok} of {outcome.frames} frames reconstructed, "
            f"{outcome.failed} failed{_doubt(outcome)}; {new} in this run, {outcome.seconds:.1f} s"
        )


def _doubt(outcome: Outcome) -> str:
    return f", {outcome.unreliable} UNRELIABLE ({', '.join(outcome.doubts)}): see frames.csv" if outcome.doubts else ""
