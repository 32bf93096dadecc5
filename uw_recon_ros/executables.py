"""Where the nodes' executables begin and end.

Signals are noted before anything is loaded, which takes a second; and after the node has ended in order the process is
left at once.
"""

from __future__ import annotations

from importlib import import_module

from uw_recon_ros import signals


def _run(module: str) -> None:
    signals.note()
    node = import_module(f"uw_recon_ros.nodes.{module}")
    signals.leave(0 if signals.came() else node.main())


def preprocess_node() -> None:
    """Run the node of this name until it is interrupted."""
    _run("preprocess_node")


def rectify_node() -> None:
    """Run the node of this name until it is interrupted."""
    _run("rectify_node")


def disparity_node() -> None:
    """Run the node of this name until it is interrupted."""
    _run("disparity_node")


def point_cloud_node() -> None:
    """Run the node of this name until it is interrupted."""
    _run("point_cloud_node")


def pipeline_node() -> None:
    """Run the node of this name until it is interrupted."""
    _run("pipeline_node")


def bag_player_node() -> None:
    """Play a bag."""
    _run("bag_player_node")
