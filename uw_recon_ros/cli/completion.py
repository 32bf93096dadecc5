"""``uw_recon completion``: what makes the shell's tab key know our subcommands, options and choices."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Collection

from uw_recon_ros.cli.common import OK
from uw_recon_ros.errors import ReconError

HELP = "print the shell's completion script"
DESCRIPTION = (
    "Shell code for standard output; needs the package argcomplete. For bash, in ~/.bashrc: "
    'eval "$(uw_recon completion bash)"; for zsh, in ~/.zshrc after compinit: eval "$(uw_recon completion zsh)".'
)
EPILOG = None
_ASKED = "_ARGCOMPLETE"  # argcomplete's protocol: set by the shell that wants an answer
_LINE = "COMP_LINE"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what it takes."""
    parser.add_argument("shell", choices=("bash", "zsh"))


def run(args: argparse.Namespace) -> int:
    """Print the code."""
    try:
        from argcomplete.shell_integration import shellcode
    except ModuleNotFoundError as error:
        raise ReconError(
            "completion: expected the package argcomplete, got none: pip install '.[completion]' in the sources' folder"
        ) from error
    sys.stdout.write(shellcode(["uw_recon"], shell=args.shell) + "\n")
    return OK


def answer_the_shell(make_parser: Callable[[Collection[str]], argparse.ArgumentParser]) -> None:
    """Tell a shell that asks how its line may go on, and exit; otherwise do nothing."""
    if _ASKED in os.environ:
        from argcomplete import autocomplete

        autocomplete(make_parser(os.environ.get(_LINE, "").split()))
