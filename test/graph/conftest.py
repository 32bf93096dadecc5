"""The installed executables as processes, on a domain of their own."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parent.parent / "nodes"))

from ros_bench import Bench

LIMIT_S = 60.0


class Executable:
    """A running executable, its output in a file."""

    def __init__(self, name: str, arguments: tuple[str, ...], log: Path) -> None:
        path = Path(sys.executable).parent / name
        assert path.exists(), f"{path}: expected an installed executable; pip install -e '.[test,ros-jazzy]'"
        self.name, self._log = name, log
        self._file = log.open("wb")
        self.process = subprocess.Popen(
            [str(path), *arguments], stdout=self._file, stderr=subprocess.STDOUT, start_new_session=True
        )

    @property
    def output(self) -> str:
        return self._log.read_text(errors="replace")

    @property
    def running(self) -> bool:
        return self.process.poll() is None

    def signal(self, number: int) -> None:
        self.process.send_signal(number)

    def wait(self) -> int:
        """Exit code; fails, and kills, after a while."""
        try:
            return self.process.wait(LIMIT_S)
        except subprocess.TimeoutExpired:
            self.end()
            pytest.fail(f"{self.name} did not end; it said:\n{self.output}")

    def end(self) -> None:
        """Ask, then kill: what is killed leaves its shared memory behind."""
        if self.running:
            self.process.send_signal(signal.SIGINT)
            try:
                self.process.wait(10.0)
            except subprocess.TimeoutExpired:
                os.killpg(self.process.pid, signal.SIGKILL)
                self.process.wait()
        self._file.close()


class Graph:
    """Executables under test."""

    def __init__(self, bench: Bench, logs: Path) -> None:
        self.bench, self._logs = bench, logs
        self.started: list[Executable] = []

    def start(self, name: str, *arguments: Any) -> Executable:
        log = self._logs / f"{len(self.started)}_{name}.log"
        self.started.append(Executable(name, tuple(map(str, arguments)), log))
        return self.started[-1]

    def spin_until(self, condition: Any, what: str = "") -> None:
        """As the bench's, but ends at once when an executable has died."""
        end = time.monotonic() + LIMIT_S
        while not condition():
            dead = [e for e in self.started if not e.running and e.process.returncode]
            assert not dead, f"{dead[0].name} ended with {dead[0].process.returncode}:\n{dead[0].output}"
            assert time.monotonic() < end, f"waited {LIMIT_S} s for {what or condition}:\n" + "\n".join(
                f"--- {e.name}\n{e.output}" for e in self.started
            )
            self.bench.executor.spin_once(timeout_sec=0.02)

    def ready(self, *names: str) -> None:
        """Spin until the named nodes are there."""
        self.spin_until(lambda: set(names) <= set(self.bench.outsider.get_node_names()), f"nodes {names}")

    def end(self) -> None:
        for executable in self.started:
            executable.end()


@pytest.fixture
def graph(tmp_path: Path) -> Iterator[Graph]:
    bench = Bench()
    graph = Graph(bench, tmp_path)
    yield graph
    graph.end()
    bench.close()
