"""``uw_recon warmup``: compile the kernels before they are needed."""

from __future__ import annotations

import argparse
import sys

from uw_recon_ros.cli.common import OK
from uw_recon_ros.progress import say

HELP = "compile all kernels now, not at the first use"
DESCRIPTION = (
    "Compile all kernels and keep them, so that no first call waits; where: $NUMBA_CACHE_DIR, else the "
    "user's cache directory."
)
EPILOG = None


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Nothing to declare."""


def run(args: argparse.Namespace) -> int:
    """Compile; the count on standard output."""
    from uw_recon_ros.jit import CACHE_DIRECTORY
    from uw_recon_ros.kernel_warmup import tell_if_cold, warm_up

    tell_if_cold(say)
    use = warm_up()
    sys.stdout.write(f"{use.compiled} kernels compiled, {use.loaded} found in {CACHE_DIRECTORY}\n")
    return OK
