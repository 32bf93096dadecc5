"""What processes do to each other: killed and started again, two graphs side by side, a clock that stands still."""

from __future__ import annotations

import fcntl
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from helpers.graph_bench import FOUR, Bench, Graph
from helpers.process_watch import mapped_segments
from helpers.ros_bench import BANDS, FOCAL, infos, own_domain
from helpers.sea_trial import SECOND, STEP, SeaTrial, arguments
from rcl_interfaces.srv import ListParameters

pytestmark = [pytest.mark.graph, pytest.mark.timeout(3600)]
PIPELINE = ("pipeline_node",)


@pytest.fixture
def started(graph: Graph) -> dict[str, object]:
    return {name: graph.start(name, *arguments()) for name in FOUR}


def test_every_node_is_killed_and_started_again(graph: Graph, started: dict, tmp_path: Path) -> None:
    """Its neighbours live on, say what is missing, and go on with whoever takes its place."""
    trial = SeaTrial(graph)
    trial.connected()
    trial.sails()
    left_behind: set[str] = set()
    for number, name in enumerate(FOUR):
        mapped = mapped_segments(started[name].process.pid)
        started[name].kill()
        left_behind |= set(filter(without_owner, mapped))
        last = trial.stamp
        for after in FOUR[number + 1 :]:
            trial.sail_until(lambda node=after: trial.complains(node, "waiting for"), f"{after} to miss {name}")
        assert max(trial.clouds) <= last
        started[name] = graph.start(name, *arguments())
        trial.sails()
    assert all(started[name].running for name in FOUR)
    make_old(left_behind)
    graph.start("disparity_node", *arguments("-r", "__node:=another"))
    graph.ready("another")
    assert len(left_behind) >= len(FOUR)
    assert not left_behind & set(os.listdir("/dev/shm"))  # freed by whoever starts next


@pytest.mark.parametrize("names", [FOUR, PIPELINE], ids=["four", "one"])
def test_one_core_is_taken_away_and_given_back(graph: Graph, names: tuple[str, ...]) -> None:
    """Right answers on the one that is left, and nobody complains; the same when both are there again."""
    running = [graph.start(name, *arguments(stall_warning_s=60.0)) for name in names]
    trial = SeaTrial(graph, names)
    trial.connected()
    trial.sails()
    cores = os.sched_getaffinity(0)
    for allowed in ({min(cores)}, cores):
        for node in running:
            confine(node.process.pid, allowed)
        trial.sails()
    assert all(node.running for node in running)


def confine(pid: int, cores: set[int]) -> None:
    """Let a process run on these cores alone, with all threads that it has."""
    for thread in os.listdir(f"/proc/{pid}/task"):
        os.sched_setaffinity(int(thread), cores)


def without_owner(segment: str) -> bool:
    """Whether whoever made a segment is gone."""
    try:
        with Path("/dev/shm", f"{segment}_el").open() as lock:
            fcntl.flock(lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
            return "port" not in segment
    except OSError:
        return False


def make_old(segments: set[str]) -> None:
    """As if their owners had died a minute ago."""
    for name in segments:
        lock = Path("/dev/shm", f"{name}_el")
        if lock.exists():
            os.utime(lock, (lock.stat().st_atime - 60, lock.stat().st_mtime - 60))


@pytest.mark.parametrize("name", ["rectify_node", "point_cloud_node"])
def test_a_node_stopped_until_it_is_forgotten_goes_on(graph: Graph, started: dict, name: str) -> None:
    """Longer than its lease: to the others it has gone and come."""
    trial = SeaTrial(graph)
    trial.connected()
    trial.sails()
    started[name].signal(signal.SIGSTOP)
    trial.sail_until(lambda: name not in graph.bench.outsider.get_node_names(), f"{name} to be forgotten")
    started[name].signal(signal.SIGCONT)
    trial.sails()


@pytest.mark.parametrize("order", [("rectify_node", "disparity_node"), ("disparity_node", "rectify_node")])
def test_two_neighbours_come_back_in_either_order(graph: Graph, started: dict, order: tuple[str, str]) -> None:
    trial = SeaTrial(graph)
    trial.connected()
    trial.sails()
    for name in order:
        started[name].kill()
    trial.sail_until(lambda: trial.complains("point_cloud_node", "waiting for"), "point_cloud_node to miss them")
    for name in order:
        started[name] = graph.start(name, *arguments())
        trial.sail_until(lambda name=name: trial.said(name).get("state") == "active", f"{name} to be there")
    trial.sails()


def test_nodes_may_start_in_any_order_and_after_the_cameras(graph: Graph) -> None:
    trial = SeaTrial(graph)
    for name in reversed(FOUR):
        graph.start(name, *arguments())
        trial.sail_until(lambda name=name: f"/{name}" in graph.said, f"{name} to be there")
    trial.sails()


def turned_about(trial: SeaTrial) -> None:
    """Other planes than everybody else's: the image stands on its head."""
    trial.images = tuple(np.ascontiguousarray(image[::-1]) for image in trial.images)


def nearest_above(trial: SeaTrial) -> None:
    """All that came is what a rig standing on its head sees."""
    expected = [FOCAL * trial.baseline_m / disparity for _, _, disparity in reversed(BANDS)]
    for stamp in trial.depths:
        np.testing.assert_allclose(trial.planes(stamp), expected, rtol=0.02)


def test_two_graphs_in_two_name_spaces(graph: Graph) -> None:
    one, other = SeaTrial(graph, PIPELINE, "/port"), SeaTrial(graph, PIPELINE, "/starboard")
    for trial in (one, other):
        graph.start("pipeline_node", *arguments("-r", f"__ns:={trial.space}"))
    beside_each_other(one, other)


@pytest.fixture
def elsewhere(tmp_path: Path) -> Iterator[Graph]:
    domain = own_domain()
    bench = Bench(domain)
    (tmp_path / "elsewhere").mkdir()
    graph = Graph(bench, tmp_path / "elsewhere", ROS_DOMAIN_ID=str(domain))
    yield graph
    graph.end()
    bench.close()


def test_two_graphs_on_two_domains(graph: Graph, elsewhere: Graph) -> None:
    one, other = SeaTrial(graph, PIPELINE), SeaTrial(elsewhere, PIPELINE)
    for each in (graph, elsewhere):
        each.start("pipeline_node", *arguments())
    beside_each_other(one, other)


def beside_each_other(one: SeaTrial, other: SeaTrial) -> None:
    """Each has the answers to its own images and no other; the end of one is nothing to the other."""
    turned_about(other)
    other.stamp += 1000 * SECOND
    for trial in (one, other):
        trial.connected()
    for _ in range(4):
        for trial in (one, other):
            trial.send(trial.stamp + STEP)
            trial.graph.spin_until(lambda t=trial: t.stamp in t.depths and t.stamp in t.clouds, "the pair's depth")
    for stamp in one.depths:
        one.check(stamp)
    nearest_above(other)
    assert not one.depths.keys() & other.depths.keys()
    other.graph.started[-1].kill()
    one.sails()


def test_a_clock_that_stands_still(graph: Graph, tmp_path: Path) -> None:
    """A paused player's /clock: what is stepped is worked on, services and diagnostics go on by their own time."""
    from helpers.ros_bench import banded_pair, color
    from rclpy.serialization import serialize_message

    from uw_recon_ros.bags.model import RawMessage
    from uw_recon_ros.bags.writer import BagWriter

    with BagWriter(tmp_path / "bag") as writer:
        for frame in range(1, 4):
            for side, image, info in zip(("left", "right"), banded_pair(), infos(frame * SECOND), strict=True):
                for topic, message in (("camera_info", info), ("image_raw", color(image, frame * SECOND))):
                    kind = f"sensor_msgs/msg/{type(message).__name__}"
                    data = bytes(serialize_message(message))
                    writer.raw(RawMessage(f"/{side}/{topic}", kind, frame * SECOND, data))
    trial = SeaTrial(graph, PIPELINE)
    graph.start("pipeline_node", *arguments(use_sim_time=True))
    player = graph.start("bag_player_node", tmp_path / "bag", "--start-paused", "--wait-for", "/left/image_raw")
    trial.connected()
    step = graph.stepper()
    for frame in (1, 2):
        step()
        graph.spin_until(lambda s=frame * SECOND: s in trial.depths and s in trial.clouds, f"frame {frame}")
        trial.check(frame * SECOND)
        names = graph.call("/pipeline_node/list_parameters", ListParameters, ListParameters.Request()).result.names
        assert "max_disparity" in names
        graph.said.clear()
        graph.spin_until(lambda: trial.said("pipeline_node").get("state") == "active", "diagnostics")
        assert (
            float(trial.said("pipeline_node")["latency [s]"].split()[-1]) < 60.0
        )  # of the bag's clock, not the wall's
    player.kill()  # no clock at all any more
    trial.sails()
