"""Running a node as a process: start, spin, end, and the exit code.

A signal interrupts nothing: it sets a flag that the main loop looks at. Then everything ends in order: the node shuts
down, so that nothing is sent any more; it is destroyed; ROS ends; the process leaves, if need be without waiting for a
thread that is computing. Should anything hold up the main thread, the process leaves all the same.
"""

from __future__ import annotations

import argparse
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from uw_recon_ros.ros import transport
from uw_recon_ros.ros.node import StageNode
from uw_recon_ros.ros.parameters import ParameterError

DONE, FAILED, USAGE = 0, 1, 2
_FOR_THREADS_S = 0.5
_FOR_EVERYTHING_S = 1.5

_asked = threading.Event()


def start(args: Sequence[str] | None) -> None:
    """Initialise ROS with a transport fit for images.

    Raises
    ------
    ParameterError
        The ROS arguments, or the parameter file they name, are refused.
    """
    warning = transport.prepare()
    try:
        rclpy.init(args=None if args is None else list(args), signal_handler_options=SignalHandlerOptions.NO)
    except (RuntimeError, ValueError) as error:  # RCLError, UnknownROSArgsError are RuntimeErrors
        raise ParameterError(" ".join(str(error).split())) from error
    if warning:
        rclpy.logging.get_logger("uw_recon_ros").warning(warning)


def interrupted() -> bool:
    """Whether SIGINT or SIGTERM came."""
    return _asked.is_set()


def _on_signal(*_: Any) -> None:
    if not _asked.is_set():
        _asked.set()
        last_resort = threading.Timer(_FOR_EVERYTHING_S, _leave_now, (DONE,))
        last_resort.daemon = True
        last_resort.start()


@contextmanager
def until_shutdown() -> Iterator[None]:
    """Note signals instead of being interrupted by them, for good; let a shutdown from elsewhere end the block."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _on_signal)
    with suppress(ExternalShutdownException):
        yield


def leave(code: int, *, clean: bool = True) -> int:
    """End ROS; return the exit code, or leave at once where a thread is still computing."""
    rclpy.try_shutdown()
    if not clean:  # the interpreter would wait for, or trip over, compiled code still running
        _leave_now(code)
    return code


def _leave_now(code: int) -> None:
    transport.clean_up()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code)


def command_line(about: str | None, args: Sequence[str] | None) -> None:
    """Answer ``--help``, and refuse what is neither a ROS argument nor understood."""
    parser = argparse.ArgumentParser(
        description=about, formatter_class=argparse.RawDescriptionHelpFormatter,
        epilog="Parameters, remaps and namespaces are ROS arguments: --ros-args -p NAME:=VALUE -r FROM:=TO",
    )  # fmt: skip
    parser.parse_args(remove_ros_args(sys.argv if args is None else ["", *args])[1:])


def run(make: Callable[[], StageNode[Any]], about: str | None, args: Sequence[str] | None = None) -> int:
    """Run a stage node until it is interrupted.

    Parameters
    ----------
    make : callable
        Makes the node once ROS is initialised.
    about : str or None
        What ``--help`` says.
    args : sequence of str or None
        Arguments; None: the process's.

    Returns
    -------
    int
        Exit code: 0 after SIGINT, SIGTERM or a shutdown; 2 for refused parameters or arguments.
    """
    node, clean = None, True
    try:
        with until_shutdown():
            start(args)
            command_line(about, args)
            node = make()
            executor = SingleThreadedExecutor()
            executor.add_node(node)
            while not interrupted() and rclpy.ok():  # the node's timers wake the executor several times a second
                executor.spin_once()
    except ParameterError as error:
        print(f"error: {error}", file=sys.stderr)  # noqa: T201
        return leave(USAGE)
    finally:
        if node is not None:
            clean = node.stop(_FOR_THREADS_S)
            node.destroy_node()
    return leave(DONE, clean=clean)
