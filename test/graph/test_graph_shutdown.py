"""Every executable ends well, whatever it is doing: exit code 0, no stack trace, no hanging."""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from typing import Any

import pytest
from helpers.flood import Source
from helpers.lifecycle_manager import CONFIGURE, SHUTDOWN, Manager
from sensor_msgs.msg import Image
from stereo_msgs.msg import DisparityImage

from uw_recon_ros.ros.diagnostics import SUPERSEDED

pytestmark = [pytest.mark.graph, pytest.mark.timeout(3600)]
STAGE_NODES = (
    "preprocess_node",
    "rectify_node",
    "disparity_node",
    "point_cloud_node",
    "pipeline_node",
    "odometry_node",
    "model_node",
    "calibrate_node",
)
ALL = (*STAGE_NODES, "bag_player_node")
BAG = Path(__file__).parents[2] / "bags" / "amphora"
BOTH = pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=["SIGINT", "SIGTERM"])
SIGNS_OF_A_CRASH = ("Traceback", "Fatal Python error", "terminate called", "Segmentation fault")


def start(graph: Any, name: str, *arguments: Any, code: str = "") -> Any:
    """Start an executable, or what `code` does in its place."""
    own = (BAG, "--start-paused") if name == "bag_player_node" else ()
    instead = (Path(sys.executable).name, "-c", code) if code else (name,)
    return graph.start(*instead, *own, *arguments)


def end(executables: list[Any], number: int) -> None:
    """Send the signal to all of them, twice; each must end well.

    How soon is the machine's affair; that it is in time, `test_stop_signals` sees.
    """
    for executable in executables:
        executable.signal(number)
    for executable in executables:
        if executable.running:
            executable.signal(number)  # impatience does no harm
    for executable in executables:
        assert executable.wait() == 0, f"{executable.name}:\n{executable.output}"
        assert not any(sign in executable.output for sign in SIGNS_OF_A_CRASH), executable.output


@BOTH
def test_idle(graph: Any, number: int) -> None:
    executables = [start(graph, name) for name in ALL]
    graph.ready(*ALL)
    end(executables, number)
    for executable in executables[:-1]:
        said = [line for line in executable.output.splitlines() if line and "compil" not in line]
        assert said == []
    assert executables[-1].output.startswith("sent 0 messages")


@BOTH
def test_at_work(graph: Any, number: int) -> None:
    """Large images come faster than the stages are; the player plays."""
    source = Source(graph)
    for name in ("preprocess_node", "pipeline_node"):
        start(graph, name)
    start(graph, "disparity_node", "--ros-args", "-p", "effort:=quality", "-p", "max_disparity:=128")
    graph.start("bag_player_node", BAG, "--loop", "--ros-args", "-r", "__ns:=/elsewhere")
    heard = {topic: graph.bench.listen(Image, topic) for topic in ("elsewhere/left/image_raw", "left/image_enhanced")}
    graph.bench.listen(DisparityImage, "disparity")
    source.connect()

    def all_busy() -> bool:
        source.send()
        return all(f"dropped: {SUPERSEDED}" in graph.said[f"/{node.name}"] for node in graph.started[:3])

    graph.spin_until(all_busy, "work")
    graph.spin_until(lambda: heard["elsewhere/left/image_raw"], "the player")
    end(graph.started, number)


@BOTH
def test_compiling(graph: Any, number: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With nothing in the cache: tens of seconds of compilation lie ahead."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(tmp_path / "cache"))
    nodes = [start(graph, name) for name in ("disparity_node", "pipeline_node")]
    graph.spin_until(lambda: all(graph.said[f"/{node.name}"].get("warm_up") == "running" for node in nodes), "warm-up")
    end(nodes, number)


def test_in_every_state(graph: Any) -> None:
    nodes = [start(graph, name, "--ros-args", "-p", "autostart:=false") for name in STAGE_NODES[1:4]]
    managers = [Manager(graph.bench.outsider, node.name, graph.spin_until) for node in nodes]
    assert managers[1].change(CONFIGURE)
    assert managers[2].change(SHUTDOWN["unconfigured"])
    assert [manager.state for manager in managers] == ["unconfigured", "inactive", "finalized"]
    end(nodes, signal.SIGINT)


@BOTH
def test_while_starting(graph: Any, number: int, tmp_path: Path) -> None:
    """From the moment our code runs: modules are loaded, ROS starts, the node is made."""
    code = "from uw_recon_ros import executables; executables.{}()"
    for place, name in enumerate(ALL):
        starting = start(graph, name, code=code.format(name))
        graph.spin_until(lambda it=starting: handles(it.process.pid, signal.SIGTERM), "the handler")
        graph.bench.spin_for(0.25 * place)
        end([starting], number)


def handles(pid: int, number: int) -> bool:
    """Whether a process has a handler of its own for a signal."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    caught = next(int(line.split()[1], 16) for line in lines if line.startswith("SigCgt"))
    return bool(caught >> (number - 1) & 1)
