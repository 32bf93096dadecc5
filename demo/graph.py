"""The node graph as separate processes, started from the installed executables."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import IO

NODES = ("preprocess_node", "rectify_node", "disparity_node", "point_cloud_node")
_STOP_S = 5.0


def executable(name: str) -> str:
    """Path of an installed executable, beside this interpreter."""
    return str(Path(sys.executable).parent / name)


class Graph:
    """The four nodes, each a process, its output in a log file. A context manager.

    Parameters
    ----------
    logs : path
        Folder for ``NODE.log``.
    ros_args : sequence of str
        Given to every node after ``--ros-args``.
    """

    def __init__(self, logs: Path, ros_args: Sequence[str]) -> None:
        self.logs, self._ros_args = logs, list(ros_args)
        self._running: dict[str, tuple[subprocess.Popen[bytes], IO[bytes]]] = {}

    def start(self, name: str, *args: str) -> subprocess.Popen[bytes]:
        """Start one executable in a process group of its own."""
        log = (self.logs / f"{name}.log").open("wb")
        command = [executable(name), *args, "--ros-args", *self._ros_args]
        process = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT, start_new_session=True)
        self._running[name] = process, log
        return process

    def dead(self) -> list[str]:
        """Names of executables that ended on their own."""
        return [name for name, (process, _) in self._running.items() if process.poll() is not None]

    def log(self, name: str) -> str:
        """What an executable printed so far."""
        return (self.logs / f"{name}.log").read_text(errors="replace")

    def __enter__(self) -> Graph:
        for name in NODES:
            self.start(name)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for process, _ in self._running.values():
            if process.poll() is None:
                os.killpg(process.pid, signal.SIGINT)
        for process, log in self._running.values():
            try:
                process.wait(_STOP_S)
            except subprocess.TimeoutExpired:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
            log.close()
