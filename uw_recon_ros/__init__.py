"""Underwater stereo reconstruction as a ROS 2 node graph."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    __version__: str


def __getattr__(name: str) -> object:
    """`__version__`, looked up when it is asked for: package.xml is its one place."""
    if name == "__version__":
        from importlib.metadata import version

        return version(__name__)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
