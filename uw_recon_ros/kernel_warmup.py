"""Compiling before it is waited for, and saying so."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

from uw_recon_ros.jit import CACHE_DIRECTORY, CacheUse, cache_use, is_cold
from uw_recon_ros.match.methods import EFFORTS, METHODS
from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.reconstruct.stage import Reconstruct

#: Folder of each method's kernels.
_KERNELS = {"graph_cut": "planes", "kz2": "kz2"}


def warm_up() -> CacheUse:
    """Have every kernel of the stages compiled and kept; return what had to be."""
    for effort in EFFORTS:
        Match(MatchParams(effort=effort)).warm_up()
    for method in METHODS:
        Match(MatchParams(method=method)).warm_up()
    Reconstruct().warm_up()
    return cache_use()


def tell_if_cold(say: Callable[[str], None], methods: Iterable[str] = METHODS) -> None:
    """Say what the first call of these matching methods after an installation waits for."""
    folder = Path(__file__).parent / "match"
    if any(is_cold(folder / _KERNELS[method]) for method in methods):
        kept = f"kept in {CACHE_DIRECTORY}" if CACHE_DIRECTORY else "every time: no directory can be written"
        say(f"{'first start: ' if CACHE_DIRECTORY else ''}compiling kernels, about a minute; {kept}")
