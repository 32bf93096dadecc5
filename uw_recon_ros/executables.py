"""Where the executables begin and end.

Signals are noted before anything is loaded, which takes a second; and after the node has ended in order the process is
left at once.
"""

from __future__ import annotations

import os
from importlib import import_module

from uw_recon_ros import stop_signals
from uw_recon_ros.blas import one_blas_thread

# What OpenCV thinks of a damaged image is in what it returns; on the terminal stand our own words.
os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")


def _run(module: str) -> None:
    stop_signals.note()
    one_blas_thread()
    node = import_module(f"uw_recon_ros.nodes.{module}")
    stop_signals.leave(0 if stop_signals.came() else node.main())


def uw_recon() -> int:
    """Run the command line; Ctrl-C at any moment ends it with one line and 130."""
    try:
        stop_signals.interrupt_once(stop_signals.leave_interrupted)
        code: int = import_module("uw_recon_ros.cli").main()
    except KeyboardInterrupt:
        code = stop_signals.INTERRUPTED
    except SystemExit as end:  # argparse's, after --help and wrong usage
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    if stop_signals.came():  # whatever became of the exception
        stop_signals.leave_interrupted(code)
    stop_signals.ignore_interrupts()  # the interpreter's farewell takes a while
    return code


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


def odometry_node() -> None:
    """Run the node of this name until it is interrupted."""
    _run("odometry_node")


def model_node() -> None:
    """Run the node of this name until it is interrupted."""
    _run("model_node")


def calibrate_node() -> None:
    """Run the node of this name until it is interrupted."""
    _run("calibrate_node")


def web_node() -> None:
    """Run the node of this name until it is interrupted."""
    _run("web_node")


def bag_player_node() -> None:
    """Play a bag."""
    _run("bag_player_node")
