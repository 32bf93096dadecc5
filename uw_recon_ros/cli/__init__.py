"""The command line ``uw_recon``: arguments in, exit code out. The work of each subcommand is done elsewhere.

A file a subcommand: `HELP`, `DESCRIPTION`, `EPILOG`, `add_arguments` and `run`. Heavy imports stand inside the
functions, so that ``--help`` need not wait for the matcher's.
"""

from __future__ import annotations

import argparse
import os
import re
import sys
from collections.abc import Collection, Sequence

from uw_recon_ros import stop_signals
from uw_recon_ros.cli import (
    calibrate,
    completion,
    convert_calibration,
    disparity,
    doctor,
    evaluate,
    evaluate_model,
    info,
    measure,
    model,
    pack,
    pair,
    simulate,
    survey,
    warmup,
)
from uw_recon_ros.cli.common import FAILED, OUR_FAULT, USAGE, UsageError
from uw_recon_ros.errors import ReconError
from uw_recon_ros.progress import say
from uw_recon_ros.system_errors import explain, our_fault

_MODULES = (
    pair, disparity, pack, info, simulate, evaluate, doctor, warmup, survey, model, evaluate_model, convert_calibration,
    calibrate, measure, completion,
)  # fmt: skip
VERBS = {verb.__name__.rpartition(".")[2].replace("_", "-"): verb for verb in _MODULES}


#: A pixel left of the image, ``-5,200``, which argparse takes for an option unless there is a space in it.
_NEGATIVE_POINT = re.compile(r"-[\d.]+,-?[\d.]+")


class _Version(argparse.Action):
    """As argparse's own, but the version is looked up when it is asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        import uw_recon_ros

        sys.stdout.write(f"uw_recon {uw_recon_ros.__version__}\n")
        parser.exit()


def make_parser(words: Collection[str] = tuple(VERBS)) -> argparse.ArgumentParser:
    """The parser of all subcommands; only those that stand among `words` know their arguments."""
    top = argparse.ArgumentParser(prog="uw_recon", description="Underwater stereo reconstruction.")
    top.add_argument("--version", action=_Version, nargs=0, help="show program's version number and exit")
    commands = top.add_subparsers(required=True, metavar="SUBCOMMAND")
    for name, verb in VERBS.items():
        sub = commands.add_parser(name, help=verb.HELP, description=verb.DESCRIPTION, epilog=verb.EPILOG)
        sub.set_defaults(run=verb.run)
        if name in words:
            verb.add_arguments(sub)
    return top


def main(argv: Sequence[str] | None = None) -> int:
    """Run one subcommand.

    Returns
    -------
    int
        0 done, 1 failed (one line on standard error says what and why), 2 wrong usage, 70 internal error,
        130 after Ctrl-C.
    """
    try:
        return _run(sys.argv[1:] if argv is None else argv)
    except UsageError as error:
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
        stop_signals.tell_interrupted("interrupted")
        return stop_signals.INTERRUPTED
    except Exception as error:
        return _fail(our_fault(error), OUR_FAULT)


def _run(words: Sequence[str]) -> int:
    completion.answer_the_shell(make_parser)
    parser = make_parser(words)
    if not words:
        parser.print_help(sys.stderr)
        return USAGE
    args = parser.parse_args([f" {word}" if _NEGATIVE_POINT.fullmatch(word) else word for word in words])
    code: int = args.run(args)
    return code


def _fail(error: object, code: int) -> int:
    if stop_signals.came():  # what an interrupt became on its way through a library
        return code
    say("uw_recon: " + " ".join(str(error).split()))
    return code
