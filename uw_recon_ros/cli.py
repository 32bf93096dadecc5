"""The command line ``uw_recon``: arguments in, exit code out. The work of each subcommand is done elsewhere.

Imports stand inside the functions, so that ``--help`` need not wait for the matcher's.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, TypeVar

from uw_recon_ros import __version__
from uw_recon_ros.errors import ReconError
from uw_recon_ros.pairing import PAIR_TOLERANCE_MS
from uw_recon_ros.progress import progress, say
from uw_recon_ros.survey.command import add_survey
from uw_recon_ros.system_errors import explain, our_fault

if TYPE_CHECKING:
    from uw_recon_ros.pipeline import PipelineParams

T = TypeVar("T")
OK, FAILED, USAGE = 0, 1, 2
_LONGEST_LOOK_S = 3600.0
_LARGEST_TOLERANCE_MS = 1e3


class _UsageError(Exception):
    """Arguments that cannot be meant."""


def _params(args: argparse.Namespace, **given: object) -> PipelineParams:
    """Merge the parameter file with options given on the command line, which win."""
    from uw_recon_ros.pipeline import PipelineParams, read_values

    options = {name: value for name, value in given.items() if value is not None}
    try:
        return PipelineParams.from_mapping((read_values(args.params) if args.params else {}) | options)
    except (TypeError, ValueError) as error:
        raise _UsageError(str(error)) from error


def _shown(what: str) -> Callable[[Collection[T]], Iterable[T]]:
    """How far a loop is, told on standard error."""
    return lambda items: progress(items, what, len(items))


def _pair(args: argparse.Namespace) -> int:
    from uw_recon_ros.pair import reconstruct_files

    report = reconstruct_files(
        args.left, args.right, args.output, _params(args), args.calibration, overwrite=args.overwrite
    )
    _warn(report["warnings"])
    rectification, matching = report["rectification"], report["matching"]
    median = rectification["row_error_median_px"]
    say(
        f"{args.output}/index.html: row error {'not known' if median is None else f'{median:.2f} px'}, "
        f"density {matching['density']:.0%}, scale {report['scale']}"
        f"{'' if report['reliable'] else ', NOT RELIABLE: see the warnings'}"
    )
    return OK


def _warn(warnings: Iterable[Mapping[str, str]]) -> None:
    for warning in warnings:
        say(f"{'UNRELIABLE' if warning['severity'] == 'unreliable' else 'warning'}: {warning['text']}")


def _disparity(args: argparse.Namespace) -> int:
    from uw_recon_ros.pair import match_files

    names = ("min_disparity", "max_disparity", "method", "effort")
    params = _params(args, **{name: getattr(args, name) for name in names})
    report = match_files(args.left, args.right, args.output, params.match, overwrite=args.overwrite)
    _warn(report["warnings"])
    sys.stdout.write(json.dumps(report) + "\n")
    return OK


def _warmup(args: argparse.Namespace) -> int:
    from uw_recon_ros.jit import CACHE_DIRECTORY
    from uw_recon_ros.warm import tell_if_cold, warm_up

    tell_if_cold(say)
    use = warm_up()
    sys.stdout.write(f"{use.compiled} kernels compiled, {use.loaded} found in {CACHE_DIRECTORY}\n")
    return OK


def _pack(args: argparse.Namespace) -> int:
    from uw_recon_ros.bags.pack import pack
    from uw_recon_ros.calibration import read_calibration

    calibration = read_calibration(args.calibration) if args.calibration else None
    pack(args.left, args.right, args.output, calibration=calibration, rate_hz=args.rate, progress=_shown("pairs"))
    return OK


def _info(args: argparse.Namespace) -> int:
    from uw_recon_ros.bags.info import bag_info

    if not 0 <= args.pair_tolerance_ms <= _LARGEST_TOLERANCE_MS:
        raise _UsageError(
            f"--pair-tolerance-ms: expected 0 to {_LARGEST_TOLERANCE_MS:g}, got {args.pair_tolerance_ms:g}"
        )
    found = bag_info(args.bag, tolerance_ns=round(args.pair_tolerance_ms * 1e6))
    sys.stdout.write(f"{json.dumps(found.as_dict(), allow_nan=False) if args.json else found}\n")
    return OK if found.reconstructable else FAILED


def _simulate(args: argparse.Namespace) -> int:
    from uw_recon_ros.simulate.course import CourseParams, defaults_on
    from uw_recon_ros.simulate.params import SimulateParams
    from uw_recon_ros.simulate.write import simulate, simulate_survey

    given = {spec.name: getattr(args, spec.name) for spec in (*SimulateParams.specs(), *CourseParams.specs())}
    given = {name: value for name, value in given.items() if value is not None}
    stray = sorted({spec.name for spec in CourseParams.specs()} & set(given)) if args.track is None else []
    if stray or (args.truth and args.track is None):
        names = ", ".join(f"--{name.replace('_', '-')}" for name in stray or ["truth"])
        raise _UsageError(f"{names}: expected --track with it, got none")
    try:
        if args.track is None:
            simulate(args.output, SimulateParams.from_mapping(given), progress=_shown("frames"))
        else:
            params = SimulateParams.from_mapping(defaults_on(args.track) | given)
            course = CourseParams.from_mapping(given)
            simulate_survey(args.output, params, course, args.truth, progress=_shown("frames"))
    except (TypeError, ValueError) as error:
        raise _UsageError(str(error)) from error
    return OK


def _evaluate(args: argparse.Namespace) -> int:
    from uw_recon_ros.evaluate import as_table, evaluate, read_disparity
    from uw_recon_ros.images import read_image, to_gray

    mask = to_gray(read_image(args.mask)) == 255 if args.mask else None
    estimate, truth = read_disparity(args.estimate), read_disparity(args.truth)
    try:
        result = evaluate(estimate, truth, mask)
    except ValueError as error:
        raise ReconError(f"{args.estimate}, {args.truth}: {error}") from error
    say(as_table(result))
    sys.stdout.write(json.dumps(result.as_dict()) + "\n")
    return OK


def _doctor(args: argparse.Namespace) -> int:
    from uw_recon_ros.doctor.diagnose import diagnose
    from uw_recon_ros.doctor.text import as_json, as_table

    if not 0 < args.seconds <= _LONGEST_LOOK_S:
        raise _UsageError(f"--seconds: expected more than 0 and at most {_LONGEST_LOOK_S:g}, got {args.seconds:g}")
    try:
        from uw_recon_ros.ros.observer.observe import observe
    except ModuleNotFoundError as error:
        raise ReconError(
            f"doctor: expected ROS 2, no module {error.name}: source its setup.bash, or pip install "
            "'uw_recon_ros[ros-jazzy]'"
        ) from error
    try:
        seen = observe(args.namespace, args.seconds, args.ros_args)
    except ValueError as error:
        raise _UsageError(str(error)) from error
    diagnosis = diagnose(seen)
    sys.stdout.write((as_json if args.json else as_table)(diagnosis) + "\n")
    return OK if diagnosis.healthy else FAILED


def _add_doctor(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    sub = commands.add_parser(
        "doctor",
        help="say why a running graph brings no cloud",
        description="Look at the running nodes, cameras to cloud, and name what is wrong and what to do about it.",
        epilog="Exit code: 0 clouds come, 1 a problem was found (the last line names the most likely cause), 2 wrong "
        "usage. ROS_DOMAIN_ID and the like are taken from the environment.",
    )
    sub.add_argument("--namespace", metavar="NS", help="of the nodes; default: where they are found")
    sub.add_argument(
        "--seconds", type=float, default=10.0, metavar="N", help="watch so long at most (default %(default)s)"
    )
    sub.add_argument("--json", action="store_true", help="one JSON object instead of the table")
    sub.add_argument(
        "--ros-args", nargs=argparse.REMAINDER, default=[], metavar="...", help="as for the nodes: -r FROM:=TO; last"
    )
    sub.set_defaults(run=_doctor)


def _add_pair(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    sub = commands.add_parser("pair", help="reconstruct one image pair", description="The whole pipeline on one pair.")
    sub.add_argument("left", help="image of the left camera (the upper or lower one of a vertical rig)")
    sub.add_argument("right", help="image of the right camera")
    sub.add_argument("-o", "--output", required=True, metavar="DIR", help="folder to fill; index.html shows it all")
    sub.add_argument("--calibration", metavar="FILE", help="two camera_info YAML documents, left and right")
    sub.add_argument("--params", metavar="FILE", help="ROS parameter file")
    sub.add_argument("--overwrite", action="store_true", help="replace files of an earlier run")
    sub.set_defaults(run=_pair)


def _add_disparity(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    from uw_recon_ros.match.methods import EFFORTS, METHODS

    sub = commands.add_parser(
        "disparity", help="match an already rectified pair", description="Match a rectified pair; JSON on stdout."
    )
    sub.add_argument("left")
    sub.add_argument("right")
    sub.add_argument(
        "-o", "--output", required=True, metavar="FILE", help=".pfm (invalid = inf), .tiff (float32, invalid = NaN) "
        "or .png (16 bits, 256 times the disparity, invalid = 0)",
    )  # fmt: skip
    sub.add_argument("--overwrite", action="store_true", help="replace the file if there is one")
    sub.add_argument("--max-disparity", type=int, metavar="N", help="inclusive, px; default: found from the images")
    sub.add_argument("--min-disparity", type=int, metavar="N", help="inclusive, px")
    sub.add_argument("--method", choices=METHODS, help="default: the first, or what the parameter file says")
    sub.add_argument(
        "--effort",
        choices=EFFORTS,
        help="of graph_cut: navigation takes a tenth of a second for 640x480 pixels and makes no cut; balanced (the "
        "default) cuts, in about a second; quality cuts until little moves any more, in many seconds",
    )
    sub.add_argument("--params", metavar="FILE", help="ROS parameter file")
    sub.set_defaults(run=_disparity)


def _add_bags(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    sub = commands.add_parser("pack", help="put folders of stills into a bag", description="Stills to a rosbag2 bag.")
    sub.add_argument("--left", required=True, metavar="GLOB", help="left images, quoted: 'left/*.png'")
    sub.add_argument("--right", required=True, metavar="GLOB")
    sub.add_argument("-o", "--output", required=True, metavar="BAG")
    sub.add_argument("--calibration", metavar="FILE", help="two camera_info YAML documents, left and right")
    sub.add_argument("--rate", type=float, default=2.0, metavar="HZ", help="pairs a second (default %(default)s)")
    sub.set_defaults(run=_pack)

    sub = commands.add_parser(
        "info",
        help="tell whether a bag can be reconstructed",
        epilog="Exit code: 0 it can, 1 it cannot, 2 wrong usage.",
    )
    sub.add_argument("bag")
    sub.add_argument("--json", action="store_true", help="one JSON object instead of the text")
    sub.add_argument(
        "--pair-tolerance-ms", type=float, default=PAIR_TOLERANCE_MS, metavar="MS",
        help="largest difference of stamps within a pair, as for survey (default %(default)s)",
    )  # fmt: skip
    sub.set_defaults(run=_info)


def _add_simulate(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    from uw_recon_ros.simulate.course import ON_A_TRACK, CourseParams
    from uw_recon_ros.simulate.params import SimulateParams

    sub = commands.add_parser(
        "simulate",
        help="make a bag with known depth",
        description="Ray-cast a stereo dive through simulated water; the bag holds the true depth too.",
    )
    sub.add_argument("-o", "--output", required=True, metavar="BAG")
    sub.add_argument("--truth", metavar="DIR", help="with --track: folder for trajectory.txt (TUM) and surface.ply")
    for spec in (*CourseParams.specs(), *SimulateParams.specs()):
        option = f"--{spec.name.replace('_', '-')}"
        default = "none: past one scene" if spec.name == "track" else spec.default
        other = f"; {ON_A_TRACK[spec.name]} with --track" if spec.name in ON_A_TRACK else ""
        text = f"{spec.doc} {spec.unit} (default {default}{other})".replace("%", "%%")
        if spec.type is bool:
            sub.add_argument(option, action=argparse.BooleanOptionalAction, help=text)
        elif spec.choices:
            sub.add_argument(option, choices=spec.choices, help=text)
        else:
            sub.add_argument(option, type=spec.type, metavar="X", help=text)
    sub.set_defaults(run=_simulate)


def _add_evaluate(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    sub = commands.add_parser(
        "evaluate",
        help="compare a disparity map with the truth",
        description="A table on standard error, JSON on standard output; bad-x is the share of pixels, in percent, "
        "whose error is over x px.",
    )
    sub.add_argument("estimate", help="PFM or float TIFF; inf or NaN = invalid")
    sub.add_argument("truth", help="the same; inf = unknown")
    sub.add_argument("--mask", metavar="PNG", help="255 = count this pixel")
    sub.set_defaults(run=_evaluate)


def _add_warmup(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    sub = commands.add_parser(
        "warmup",
        help="compile everything now",
        description="Compile all kernels and keep them, so that no first call waits; where: $NUMBA_CACHE_DIR, else the "
        "user's cache directory.",
    )
    sub.set_defaults(run=_warmup)


def parser() -> argparse.ArgumentParser:
    """The parser of all subcommands."""
    top = argparse.ArgumentParser(prog="uw_recon", description="Underwater stereo reconstruction.")
    top.add_argument("--version", action="version", version=f"uw_recon {__version__}")
    commands = top.add_subparsers(required=True, metavar="SUBCOMMAND")
    for add in (_add_pair, _add_disparity, _add_bags, _add_simulate, _add_evaluate, _add_doctor, _add_warmup):
        add(commands)
    add_survey(commands, _params, _UsageError)
    return top


def main(argv: Sequence[str] | None = None) -> int:
    """Run one subcommand.

    Returns
    -------
    int
        0 done, 1 failed (one line on standard error says what and why), 2 wrong usage.
    """
    if not (sys.argv[1:] if argv is None else argv):
        parser().print_help(sys.stderr)
        return USAGE
    args = parser().parse_args(argv)
    try:
        code: int = args.run(args)
    except _UsageError as error:
        return _fail(error, USAGE)
    except ReconError as error:
        return _fail(error, FAILED)
    except BrokenPipeError:  # whoever reads our output has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return FAILED
    except OSError as error:
        return _fail(explain(error), FAILED)
    except MemoryError:
        return _fail("no memory is left: close some programs, take smaller images, or use fewer jobs", FAILED)
    except KeyboardInterrupt:
        return _fail("interrupted", FAILED)
    except Exception as error:
        return _fail(our_fault(error), FAILED)
    return code


def _fail(error: object, code: int) -> int:
    say("uw_recon: " + " ".join(str(error).split()))
    return code


if __name__ == "__main__":
    raise SystemExit(main())
