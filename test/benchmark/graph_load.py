"""The four nodes as processes under a live load: how fresh, how steady, and what each costs.

Usage: python test/benchmark/graph_load.py [--rates 5 10 15] [--seconds 20] [--size 640x480] [--odometry]
    [--composed] [-p NAME:=VALUE ...] [--output FILE]

A simulated dive of known depth is played in real time to the four nodes, each a process (``--composed``: to
``pipeline_node``), with
``config/navigation.yaml`` and 64 disparities; the listener takes what a navigation stack takes, ``points2_filtered``
and ``depth/image_rect``. For each camera rate:

- rate: clouds a second;
- latency: from the moment the player sends a pair (the middleware's source time stamp) to that of having its cloud;
- dropped: pairs that were overtaken, in percent;
- CPU: of each node, ms a pair it worked on, and in percent of one core; of that the executor's thread (messages,
  timers); what the node takes without any pairs, ms a second; page faults a pair;
- odometry: with ``--odometry`` odometry_node runs beside them; its messages a second;
- error: median of |Z - true Z| / true Z over the points of ``points2_filtered``, in percent.

Wall times mean something on an idle machine only; CPU times a pair do elsewhere too.
"""

# ruff: noqa: T201, E402

from __future__ import annotations

import argparse
import json
import statistics
import sys
import tempfile
import time
from collections import defaultdict
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

import cv2
import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from helpers.graph_bench import BETWEEN, FOUR, Bench, Graph
from helpers.process_watch import Usage, usage
from nav_msgs.msg import Odometry
from sensor_msgs.msg import CameraInfo, Image, PointCloud2

from uw_recon_ros.bags.writer import BagWriter
from uw_recon_ros.ros.messages import stamp_ns
from uw_recon_ros.simulate.dive import Dive
from uw_recon_ros.simulate.params import SimulateParams
from uw_recon_ros.simulate.rig import LEFT_FRAME, RIGHT_FRAME

NAVIGATION = HERE.parents[1] / "config" / "navigation.yaml"
RECORDED_HZ = 10.0
VIEWS = 6  # rendered; the bag goes through them to and fro
WARM_S = 2.0  # after the first cloud, before anything is measured
IDLE_S = 10.0  # without a pair
SECOND = 1_000_000_000


class Sea:
    """A simulated dive as a bag, and its truth."""

    def __init__(self, path: Path, width: int, height: int, frames: int) -> None:
        self.path = path
        dive = Dive(SimulateParams(scene="reef", seed=3, width=width, height=height, frames=VIEWS, rate_hz=RECORDED_HZ))
        self.left = dive.calibration.left
        views = [dive.frame(index) for index in range(VIEWS)]
        self.depths: dict[int, np.ndarray] = {}
        with BagWriter(path, level=1) as writer:
            for number in range(frames):
                view = views[abs((number + VIEWS - 1) % (2 * VIEWS - 2) - VIEWS + 1)]
                stamp = round((number + 1) * SECOND / RECORDED_HZ)
                self.depths[stamp] = view.depth
                # The small ones first: when the last image leaves, everything else of its pair has.
                writer.camera_info("/left/camera_info", dive.calibration.left, time_ns=stamp, frame_id=LEFT_FRAME)
                writer.camera_info("/right/camera_info", dive.calibration.right, time_ns=stamp, frame_id=RIGHT_FRAME)
                writer.image("/left/image_raw", view.left, time_ns=stamp, frame_id=LEFT_FRAME)
                writer.image("/right/image_raw", view.right, time_ns=stamp, frame_id=RIGHT_FRAME)

    def error_percent(self, cloud: PointCloud2) -> float:
        """Median relative error of a cloud's depths; the cloud is in the left camera's own frame."""
        points = np.frombuffer(cloud.data, np.float32).reshape(-1, cloud.point_step // 4)[:, :3].astype(float)
        zero = np.zeros(3)
        pixels = cv2.projectPoints(points, zero, zero, self.left.k, self.left.d)[0].reshape(-1, 2)
        truth = self.depths[stamp_ns(cloud)]
        u, v = np.rint(pixels).astype(int).T
        seen = (u >= 0) & (v >= 0) & (u < truth.shape[1]) & (v < truth.shape[0])
        true = truth[v[seen], u[seen]]
        return float(100 * np.nanmedian(np.abs(points[seen, 2] - true) / true))


@dataclass
class Heard:
    """What came out, by stamp: ns of CLOCK_REALTIME."""

    sent: dict[int, int] = field(default_factory=dict)
    clouds: dict[int, int] = field(default_factory=dict)
    odometry: list[int] = field(default_factory=list)
    depths: dict[int, int] = field(default_factory=dict)
    kept: list[PointCloud2] = field(default_factory=list)
    nodes: defaultdict[str, dict[str, str]] = field(default_factory=lambda: defaultdict(dict))

    def listen(self, bench: Bench) -> None:
        """Subscribe as a navigation stack does."""
        make = bench.outsider.create_subscription
        make(CameraInfo, "left/camera_info", self._on_info, 50)
        make(PointCloud2, "points2_filtered", self._on_cloud, 5)
        make(Odometry, "odometry", lambda m: self.odometry.append(time.time_ns()), 50)
        make(Image, "depth/image_rect", lambda m: self.depths.setdefault(stamp_ns(m), time.time_ns()), 5)
        make(DiagnosticArray, "/diagnostics", self._on_diagnostics, 50)

    def rate(self, node: str) -> float:
        """Pairs per second that a node says it sent on lately."""
        return max(float(value) for key, value in self.nodes[node].items() if key.startswith("out "))

    def _on_info(self, message: CameraInfo, about: dict[str, Any]) -> None:
        self.sent[stamp_ns(message)] = about["source_timestamp"]

    def _on_cloud(self, message: PointCloud2) -> None:
        self.clouds[stamp_ns(message)] = time.time_ns()
        self.kept = [*self.kept[-9:], message]

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self.nodes[status.name.rsplit("/", 1)[-1]] = {pair.key: pair.value for pair in status.values}


def run(sea: Sea, camera_hz: float, work: Path, parameters: list[str], names: tuple[str, ...] = FOUR) -> dict[str, Any]:
    """Play the bag at one rate; return what was measured."""
    bench, heard = Bench(), Heard()
    logs = work / f"{camera_hz:g}Hz"
    logs.mkdir()
    graph = Graph(bench, logs, ROS_PYTHON_CHECK_FIELDS="0")  # as users run them, not as tests do
    try:
        heard.listen(bench)
        arguments = ["--ros-args", "--params-file", NAVIGATION, *parameters]
        nodes = {name: graph.start(name, *arguments).process.pid for name in names}
        graph.connected(*names, chain=[topic for topic in BETWEEN if not topic.endswith(("enhanced", "color"))])
        idle = without_pairs(bench, nodes)
        topics = [f"/{side}/{topic}" for side in ("left", "right") for topic in ("image_raw", "camera_info")]
        player = graph.start("bag_player_node", sea.path, "--rate", camera_hz / RECORDED_HZ, "--wait-for", *topics)
        nodes["bag_player_node"] = player.process.pid
        graph.spin_until(lambda: heard.clouds, "the first cloud")
        bench.spin_for(WARM_S)
        begin, first = {name: usage(pid) for name, pid in nodes.items()}, time.time_ns()
        last = max(sea.depths)
        graph.spin_until(lambda: max(heard.sent) >= last - SECOND / camera_hz, "the end of the bag")
        end, final = {name: usage(pid) for name, pid in nodes.items()}, time.time_ns()
        bench.spin_for(1.5)
        return summary(sea, heard, (first, final), begin, end, idle)
    finally:
        graph.end()
        bench.close()


def without_pairs(bench: Bench, nodes: dict[str, int]) -> dict[str, float]:
    """Processor time that each node takes while no image comes, ms a second."""
    bench.spin_for(WARM_S)
    begin, at = {name: usage(pid).cpu_s for name, pid in nodes.items()}, time.monotonic()
    bench.spin_for(IDLE_S)
    seconds = time.monotonic() - at
    return {name: 1e3 * (usage(pid).cpu_s - begin[name]) / seconds for name, pid in nodes.items()}


def summary(
    sea: Sea,
    heard: Heard,
    window: tuple[int, int],
    begin: dict[str, Usage],
    end: dict[str, Usage],
    idle: dict[str, float],
) -> dict[str, Any]:
    """Numbers of one run, of what was sent within `window`."""
    first, final = window
    seconds = (final - first) * 1e-9
    sent = {stamp: at for stamp, at in heard.sent.items() if first <= at <= final}
    latencies = sorted((heard.clouds[s] - sent[s]) * 1e-9 for s in heard.clouds.keys() & sent.keys())
    clouds = sum(first <= at <= final for at in heard.clouds.values())
    pairs = {name: seconds * heard.rate(name) for name in begin if name != "bag_player_node"} | {
        "bag_player_node": len(sent)
    }
    if not latencies:
        raise SystemExit(f"no cloud of a pair sent in these {seconds:.0f} s: the machine is busy; give more --seconds")
    gaps = np.diff(sorted(heard.clouds.values())) * 1e-9
    return {
        "seconds": seconds,
        "cameras_hz": len(sent) / seconds,
        "clouds_hz": clouds / seconds,
        "depths_hz": sum(first <= at <= final for at in heard.depths.values()) / seconds,
        "odometry_hz": sum(first <= at <= final for at in heard.odometry) / seconds,
        "latency_p50_s": statistics.median(latencies),
        "latency_p95_s": latencies[int(0.95 * (len(latencies) - 1))],
        "latency_max_s": latencies[-1],
        "longest_gap_s": float(gaps.max()),
        "dropped_percent": 100 * (1 - len(latencies) / len(sent)),
        "error_percent": statistics.median(map(sea.error_percent, heard.kept)),
        "nodes": {
            name: {
                "cpu_ms_a_pair": 1e3 * (end[name].cpu_s - begin[name].cpu_s) / max(pairs[name], 1),
                "executor_ms_a_pair": 1e3 * (end[name].executor_s - begin[name].executor_s) / max(pairs[name], 1),
                "idle_ms_a_second": idle.get(name, 0.0),
                "faults_a_pair": (end[name].faults - begin[name].faults) / max(pairs[name], 1),
                "cpu_percent": 100 * (end[name].cpu_s - begin[name].cpu_s) / seconds,
                "rss_mb": end[name].rss_mb,
                "threads": end[name].threads,
                "work_s": heard.nodes[name].get("work [s]", ""),
            }
            for name in begin
        },
    }


def show(rate: float, result: dict[str, Any]) -> None:
    """Print one run."""
    print(
        f"cameras {rate:4g} Hz: clouds {result['clouds_hz']:5.2f} Hz, depth {result['depths_hz']:5.2f} Hz, "
        f"latency p50 {result['latency_p50_s']:.3f} p95 {result['latency_p95_s']:.3f} max "
        f"{result['latency_max_s']:.3f} s, longest gap {result['longest_gap_s']:.2f} s, dropped "
        f"{result['dropped_percent']:.0f} %, error {result['error_percent']:.2f} %"
    )
    if result["odometry_hz"]:
        print(f"    odometry {result['odometry_hz']:.2f} Hz")
    for name, node in result["nodes"].items():
        print(
            f"    {name:18s}{node['cpu_ms_a_pair']:7.1f} ms CPU a pair (executor {node['executor_ms_a_pair']:4.1f}; "
            f"{node['faults_a_pair']:5.0f} page faults) {node['cpu_percent']:6.1f} % of a core "
            f"(idle {node['idle_ms_a_second'] / 10:.1f}) "
            f"{node['rss_mb']:6.0f} MB {node['threads']:3d} threads   work: {node['work_s']}"
        )
    total, cores = (sum(node[key] for node in result["nodes"].values()) for key in ("cpu_ms_a_pair", "cpu_percent"))
    print(f"    {'together':18s}{total:7.1f} ms CPU a pair {cores:6.1f} % of a core", flush=True)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rates", nargs="+", type=float, default=[5.0, 10.0, 15.0], help="of the cameras, Hz")
    parser.add_argument("--seconds", type=float, default=20.0, help="of the bag, at 10 Hz")
    parser.add_argument("--size", default="640x480")
    parser.add_argument("--max-disparity", type=int, default=63)
    parser.add_argument("--odometry", action="store_true", help="odometry_node beside them")
    parser.add_argument("--composed", action="store_true", help="pipeline_node in place of the four")
    parser.add_argument(
        "-p", action="append", default=[], dest="parameters", help="a parameter of the nodes, NAME:=VALUE"
    )
    parser.add_argument("--output", type=Path)
    args = parser.parse_args()
    width, height = map(int, args.size.split("x"))
    parameters = ["-p", "min_disparity:=0", "-p", f"max_disparity:={args.max_disparity}"]
    parameters += [word for given in args.parameters for word in ("-p", given)]
    stages = ("pipeline_node",) if args.composed else FOUR
    results, names = {}, (*stages, "odometry_node") if args.odometry else stages
    with tempfile.TemporaryDirectory(prefix="uw_recon_load_") as folder:
        sea = Sea(Path(folder) / "sea", width, height, round(args.seconds * RECORDED_HZ))
        for rate in args.rates:
            results[f"{rate:g}"] = run(sea, rate, Path(folder), parameters, names)
            show(rate, results[f"{rate:g}"])
    if args.output:
        args.output.write_text(json.dumps(results, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
