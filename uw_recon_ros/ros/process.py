"""Running a node as a process: start, spin, end, and the exit code.

A signal interrupts nothing, it is noted (`stop_signals`) for the main loop to see. Then all ends in order: the node
shuts down, so that nothing is sent any more; it is destroyed; ROS ends; the process leaves. Where the worker's thread
is still computing, it leaves without the interpreter's farewell: a thread that comes back from compiled code into an
interpreter that has ended is unwound by force, and the C library aborts the process if it stood in C++ ("FATAL:
exception not rethrown").
"""

from __future__ import annotations

import argparse
import re
import sys
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from itertools import pairwise
from pathlib import Path
from typing import Any

import rclpy
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import LoggingSeverity
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import remove_ros_args

from uw_recon_ros import stop_signals
from uw_recon_ros.ros import allocator, fastdds
from uw_recon_ros.ros.node import StageNode
from uw_recon_ros.ros.parameters import ParameterError

DONE, FAILED, USAGE = 0, 1, 2
_FOR_THREADS_S = 0.5


def start(args: Sequence[str] | None) -> None:
    """Initialise ROS with a transport and an allocator fit for images.

    Raises
    ------
    ParameterError
        The ROS arguments, or the parameter file they name, are refused.
    """
    allocator.keep_freed_memory()
    warning = fastdds.prepare()
    given = list(sys.argv if args is None else args)
    _check_files(given)
    rclpy.logging.set_logger_level("rcl", LoggingSeverity.FATAL)  # its own words for what is said below
    try:
        rclpy.init(args=given, signal_handler_options=SignalHandlerOptions.NO)
    except (RuntimeError, ValueError) as error:  # RCLError, UnknownROSArgsError are RuntimeErrors
        raise ParameterError(_in_our_words(error)) from error
    finally:
        rclpy.logging.set_logger_level("rcl", LoggingSeverity.UNSET)
    if warning:
        rclpy.logging.get_logger("uw_recon_ros").warning(warning)


def _check_files(args: Sequence[str]) -> None:
    """Raise `ParameterError` for a parameter file that cannot be read."""
    for option, path in pairwise(args):
        if option == "--params-file":
            try:
                Path(path).read_bytes()
            except OSError as error:
                reason = f"expected a ROS parameter file, got {path}: {error.strerror}"
                raise ParameterError(f"--params-file: {reason}") from error


def _in_our_words(error: Exception) -> str:
    """What rcl finds wrong with the arguments, without its own source lines."""
    text = re.sub(r",? at [^\s,]+:\d+", "", " ".join(str(error).split()))
    return f"expected ROS arguments (-p NAME:=VALUE, -r FROM:=TO, --params-file FILE), got others: {text}"


@contextmanager
def until_shutdown() -> Iterator[None]:
    """Note signals instead of being interrupted by them, for good; let a shutdown from elsewhere end the block."""
    stop_signals.note(_leave_now)
    with suppress(ExternalShutdownException):
        yield


def leave(code: int, *, clean: bool = True) -> int:
    """End ROS; return the exit code, or leave at once where a thread is still computing."""
    rclpy.try_shutdown()
    fastdds.clean_up()
    if not clean:
        stop_signals.leave(code)
    return code


def _leave_now(code: int) -> None:
    fastdds.clean_up()
    stop_signals.leave(code)


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
        Exit code: 0 after SIGINT, SIGTERM or a shutdown; 1 after an error of ours; 2 for refused parameters or
        arguments.
    """
    stop_signals.note(_leave_now)
    node: StageNode[Any] | None = None
    executor: SingleThreadedExecutor | None = None
    code, clean = DONE, True
    try:
        start(args)
        command_line(about, args)
        node, executor = make(), SingleThreadedExecutor()
        executor.add_node(node)
        with suppress(ExternalShutdownException):
            while not stop_signals.came():  # the node's timers wake the executor several times a second
                executor.spin_once()
    except ParameterError as error:
        print(f"error: {error}", file=sys.stderr)  # noqa: T201
        code = USAGE
    except Exception:
        traceback.print_exc()
        code = FAILED
    if executor is not None:
        executor.shutdown()  # lets go of what it was waiting for
    if node is not None:
        clean = node.stop(_FOR_THREADS_S)
        node.destroy_node()
    return leave(code, clean=clean)
