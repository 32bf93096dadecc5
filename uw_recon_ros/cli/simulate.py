"""``uw_recon simulate``: a bag with known depth."""

from __future__ import annotations

import argparse

from uw_recon_ros.cli.common import OK, UsageError, shown

HELP = "simulate a stereo dive as a bag, with its true depth"
DESCRIPTION = "Ray-cast a stereo dive through simulated water; the bag holds the true depth too."
EPILOG = None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what it takes: every parameter of the simulation is an option."""
    from uw_recon_ros.simulate.params import ON_A_TRACK, CourseParams, SimulateParams

    parser.add_argument("-o", "--output", required=True, metavar="BAG")
    parser.add_argument("--truth", metavar="DIR", help="with --track: folder for trajectory.txt (TUM) and surface.ply")
    for spec in (*CourseParams.specs(), *SimulateParams.specs()):
        option = f"--{spec.name.replace('_', '-')}"
        default = "none: past one scene" if spec.name == "track" else spec.default
        other = f"; {ON_A_TRACK[spec.name]} with --track" if spec.name in ON_A_TRACK else ""
        text = f"{spec.doc} {spec.unit} (default {default}{other})".replace("%", "%%")
        if spec.type is bool:
            parser.add_argument(option, action=argparse.BooleanOptionalAction, help=text)
        elif spec.choices:
            parser.add_argument(option, choices=spec.choices, help=text)
        else:
            parser.add_argument(option, type=spec.type, metavar="X", help=text)


def run(args: argparse.Namespace) -> int:
    """Write the bag, and the truth where it is asked for."""
    from uw_recon_ros.simulate.params import CourseParams, SimulateParams, defaults_on
    from uw_recon_ros.simulate.write import simulate, simulate_survey

    given = {spec.name: getattr(args, spec.name) for spec in (*SimulateParams.specs(), *CourseParams.specs())}
    given = {name: value for name, value in given.items() if value is not None}
    stray = sorted({spec.name for spec in CourseParams.specs()} & set(given)) if args.track is None else []
    if stray or (args.truth and args.track is None):
        names = ", ".join(f"--{name.replace('_', '-')}" for name in stray or ["truth"])
        raise UsageError(f"{names}: expected --track with it, got none")
    try:
        if args.track is None:
            simulate(args.output, SimulateParams.from_mapping(given), progress=shown("frames"))
        else:
            params = SimulateParams.from_mapping(defaults_on(args.track) | given)
            course = CourseParams.from_mapping(given)
            simulate_survey(args.output, params, course, args.truth, progress=shown("frames"))
    except (TypeError, ValueError) as error:
        raise UsageError(str(error)) from error
    return OK
