"""The installed executables as processes: started, watched, ended."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray
from std_srvs.srv import Trigger

from helpers.ros_bench import Bench, meet

LIMIT_S = 300.0  # on hanging; no verdict on speed
FOUR = ("preprocess_node", "rectify_node", "disparity_node", "point_cloud_node")
#: What one stage has for the next.
BETWEEN = (
    *(f"{side}/image_matching" for side in ("left", "right")), "left/image_enhanced",
    *(f"rectified/{side}/{kind}" for side in ("left", "right") for kind in ("image_rect", "camera_info")),
    "rectified/left/image_rect_color", "disparity", "disparity/sigma", "disparity/status",
)  # fmt: skip


class Executable:
    """A running executable, its output in a file."""

    def __init__(self, name: str, arguments: tuple[str, ...], log: Path, environment: dict[str, str]) -> None:
        path = Path(sys.executable).parent / name
        assert path.exists(), f"{path}: expected an installed executable; pip install -e '.[test,ros-jazzy]'"
        self.name, self._log, self.killed = name, log, False
        self._file = log.open("wb")
        self.process = subprocess.Popen(
            [str(path), *arguments], stdout=self._file, stderr=subprocess.STDOUT, start_new_session=True,
            env={**os.environ, **environment},
        )  # fmt: skip

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
            self.kill()
            pytest.fail(f"{self.name} did not end; it said:\n{self.output}")

    def kill(self) -> None:
        """SIGKILL: no farewell to the others, shared memory left behind."""
        self.killed = True
        os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()

    def end(self) -> None:
        """Ask, then kill."""
        if self.running:
            try:
                self.process.wait(10.0)
            except subprocess.TimeoutExpired:
                self.kill()
        self._file.close()


class Graph:
    """Executables under test, and what their nodes say of themselves.

    `said` holds, by a node's full name, the values of its last diagnostics; ``level`` and ``message`` among them.
    """

    def __init__(self, bench: Bench, logs: Path, **environment: str) -> None:
        self.bench, self._logs, self._environment = bench, logs, environment
        self.started: list[Executable] = []
        self.said: defaultdict[str, dict[str, Any]] = defaultdict(dict)
        bench.outsider.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 100)

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            values = {pair.key: pair.value for pair in status.values}
            self.said[status.name] = {**values, "level": status.level, "message": status.message}

    def start(self, name: str, *arguments: Any) -> Executable:
        log = self._logs / f"{len(self.started)}_{name}.log"
        self.started.append(Executable(name, tuple(map(str, arguments)), log, self._environment))
        return self.started[-1]

    def spin_until(self, condition: Any, what: str = "") -> None:
        """As the bench's, but ends at once when an executable has died."""
        end = time.monotonic() + LIMIT_S
        while not condition():
            dead = [e for e in self.started if not (e.running or e.killed) and e.process.returncode]
            assert not dead, f"{dead[0].name} ended with {dead[0].process.returncode}:\n{dead[0].output}"
            assert time.monotonic() < end, f"waited {LIMIT_S} s for {what or condition}:\n" + "\n".join(
                [f"--- {e.name}\n{e.output}" for e in self.started]
                + [f"--- {name}: {said}" for name, said in self.said.items()]
            )
            self.bench.executor.spin_once(timeout_sec=0.02)

    def ready(self, *names: str) -> None:
        """Spin until the named nodes are there."""
        self.spin_until(lambda: set(names) <= set(self.bench.outsider.get_node_names()), f"nodes {names}")

    def connected(self, *nodes: str, space: str = "", chain: Iterable[str] = BETWEEN) -> None:
        """Spin until every node has found whoever reads its topics, and those of `chain` all have a reader.

        What is in the graph (`ready`, ``count_subscribers``) may not have been found by the publisher yet: only the
        publisher knows whom its next message reaches.
        """
        names = [f"{space}/{node}" for node in nodes]
        for name in names:
            self.said.pop(name, None)
        chain = chain if len(nodes) > 1 else ()
        self.spin_until(lambda: self._all_found(names, space, chain), f"{names} to find each other")

    def _all_found(self, names: list[str], space: str, chain: Iterable[str]) -> bool:
        found = {key: int(value) for name in names for key, value in self.said[name].items() if "listeners " in key}
        read = {key: self.bench.outsider.count_subscribers(f"{space}/{key.split()[1]}") for key in found}
        return bool(found) and found == read and all(found.get(f"listeners {topic}") for topic in chain)

    def call(self, service: str, kind: Any, request: Any) -> Any:
        """Call a service, once: an answer that is lost is a fault."""
        client = self.bench.outsider.create_client(kind, service)
        self.spin_until(client.service_is_ready, service)
        meet(self.bench.outsider, service.rsplit("/", 1)[0], self.spin_until)
        future = client.call_async(request)
        self.spin_until(future.done, f"{service} to answer")
        self.bench.outsider.destroy_client(client)
        return future.result()

    def stepper(self, player: str = "/bag_player_node") -> Callable[[], Any]:
        """A function that has a paused player send one frame, and waits for its answer."""
        client = self.bench.outsider.create_client(Trigger, f"{player}/step")
        self.spin_until(client.service_is_ready, f"{player}/step")
        meet(self.bench.outsider, player, self.spin_until)

        def step() -> None:
            future = client.call_async(Trigger.Request())
            self.spin_until(future.done, f"{player}/step to answer")
            assert future.result().success, future.result().message

        return step

    def end(self) -> None:
        for executable in self.started:
            if executable.running:
                executable.signal(signal.SIGINT)
        for executable in self.started:
            executable.end()
