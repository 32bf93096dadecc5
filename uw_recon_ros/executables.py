"""Where the nodes' executables begin: signals are noted before anything is loaded, which takes a second."""

from __future__ import annotations

from importlib import import_module

from uw_recon_ros import signals


def _run(module: str) -> int:
    signals.note()
    node = import_module(f"uw_recon_ros.nodes.{module}")
    return 0 if signals.came() else int(node.main())


def preprocess_node() -> int:
    """Run the node of this name until it is interrupted; return the exit code."""
    return _run("preprocess_node")


def rectify_node() -> int:
    """Run the node of this name until it is interrupted; return the exit code."""
    return _run("rectify_node")


def disparity_node() -> int:
    """Run the node of this name until it is interrupted; return the exit code."""
    return _run("disparity_node")


def point_cloud_node() -> int:
    """Run the node of this name until it is interrupted; return the exit code."""
    return _run("point_cloud_node")


def pipeline_node() -> int:
    """Run the node of this name until it is interrupted; return the exit code."""
    return _run("pipeline_node")


def bag_player_node() -> int:
    """Play a bag; return the exit code."""
    return _run("bag_player_node")
