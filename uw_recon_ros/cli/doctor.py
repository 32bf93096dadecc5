"""``uw_recon doctor``: why a running graph brings no cloud."""

from __future__ import annotations

import argparse
import sys

from uw_recon_ros.cli.common import FAILED, OK, UsageError
from uw_recon_ros.errors import ReconError

HELP = "diagnose why no point cloud is published"
DESCRIPTION = "Look at the running nodes, cameras to cloud, and name what is wrong and what to do about it."
EPILOG = (
    "Exit code: 0 clouds come, 1 a problem was found (the last line names the most likely cause), 2 wrong "
    "usage. ROS_DOMAIN_ID and the like are taken from the environment."
)
_LONGEST_LOOK_S = 3600.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what it takes."""
    parser.add_argument("--namespace", metavar="NS", help="of the nodes; default: where they are found")
    parser.add_argument(
        "--seconds", type=float, default=10.0, metavar="N", help="watch so long at most (default %(default)s)"
    )
    parser.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    parser.add_argument(
        "--ros-args", nargs=argparse.REMAINDER, default=[], metavar="...", help="as for the nodes: -r FROM:=TO; last"
    )


def run(args: argparse.Namespace) -> int:
    """Look at the graph, and say what is wrong with it."""
    from uw_recon_ros.doctor.diagnose import diagnose
    from uw_recon_ros.doctor.text import as_json, as_table

    if not 0 < args.seconds <= _LONGEST_LOOK_S:
        raise UsageError(f"--seconds: expected more than 0 and at most {_LONGEST_LOOK_S:g}, got {args.seconds:g}")
    try:
        from uw_recon_ros.ros.observer.observe import observe
    except ModuleNotFoundError as error:
        raise ReconError(
            f"doctor: expected ROS 2, no module {error.name}: source its setup.bash, or pip install "
            "'.[ros-jazzy]' in the sources' folder"
        ) from error
    try:
        seen = observe(args.namespace, args.seconds, args.ros_args)
    except ValueError as error:
        raise UsageError(str(error)) from error
    diagnosis = diagnose(seen)
    sys.stdout.write((as_json if args.json else as_table)(diagnosis) + "\n")
    return OK if diagnosis.healthy else FAILED
