"""What several subcommands share: exit codes, wrong usage, parameters, what is said on the way."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import TYPE_CHECKING, TypeVar

from uw_recon_ros.progress import Progress, say

if TYPE_CHECKING:
    from uw_recon_ros.params import ParamSpec
    from uw_recon_ros.pipeline import PipelineParams

T = TypeVar("T")
OK, FAILED, USAGE = 0, 1, 2
OUR_FAULT = 70  # EX_SOFTWARE of sysexits.h


class UsageError(Exception):
    """Arguments that cannot be meant."""


def pipeline_params(args: argparse.Namespace, **given: object) -> PipelineParams:
    """Merge the parameter file with options given on the command line, which win."""
    from uw_recon_ros.pipeline import PipelineParams, read_values

    options = {name: value for name, value in given.items() if value is not None}
    try:
        return PipelineParams.from_mapping((read_values(args.params) if args.params else {}) | options)
    except (TypeError, ValueError) as error:
        raise UsageError(str(error)) from error


def add_params(parser: argparse.ArgumentParser, specs: Iterable[ParamSpec]) -> None:
    """An option for each parameter."""
    for spec in specs:
        kind = (
            {"choices": spec.choices} if spec.choices else {"type": spec.type, "metavar": spec.type.__name__[0].upper()}
        )
        parser.add_argument(
            f"--{spec.name.replace('_', '-')}",
            help=f"{spec.doc} {f'[{spec.unit}] ' if spec.unit else ''}(default: {spec.default!r})".replace("%", "%%"),
            **kind,
        )


def add_calibration(parser: argparse.ArgumentParser) -> None:
    """The option of a rig's calibration."""
    parser.add_argument(
        "--calibration", action="append", metavar="FILE",
        help="calibration of the rig, in any form that convert-calibration reads; give it twice if left and right "
        "are in separate files",
    )  # fmt: skip


def given_params(args: argparse.Namespace, specs: Iterable[ParamSpec]) -> dict[str, object]:
    """Those that were given, by name."""
    values = {spec.name: getattr(args, spec.name) for spec in specs}
    return {name: value for name, value in values.items() if value is not None}


def shown(what: str) -> Callable[[Collection[T]], Iterable[T]]:
    """How far a loop is, told on standard error."""
    return lambda items: Progress().watch(items, what, len(items))


def warn(warnings: Iterable[Mapping[str, str]]) -> None:
    """Say a report's warnings."""
    for warning in warnings:
        say(f"{'UNRELIABLE' if warning['severity'] == 'unreliable' else 'warning'}: {warning['text']}")
