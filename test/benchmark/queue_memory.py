"""Why a node holds more memory after it was short of time: what its queues held once is kept.

Usage: python test/benchmark/queue_memory.py [--depths 5 1] [--stops 6] [--size 640x480]

`preprocess_node` reads pairs at 10 Hz. It is stopped (SIGSTOP) for a second again and again, as by a machine that is
busy with something else, so that its queues fill, and each time left alone for three. Printed: private memory at the
start, and after each stop, MB; and the images that the two queues hold when they are full. For each depth of the
queues (``qos_overrides``, 5 by default).
"""

# ruff: noqa: T201

from __future__ import annotations

import argparse
import signal
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import numpy as np
from helpers.graph_bench import Graph
from helpers.process_watch import usage
from helpers.ros_bench import Bench, color
from sensor_msgs.msg import Image

from uw_recon_ros.topics import SIDES

NODE, RATE_HZ, SECOND = "preprocess_node", 10.0, 1_000_000_000
STOPPED_S, ALONE_S, SETTLE_S = 1.0, 3.0, 10.0
NAVIGATION = Path(__file__).resolve().parents[2] / "config" / "navigation.yaml"


class Cameras:
    """Two cameras, and who listens to what the node makes of them."""

    def __init__(self, bench: Bench, width: int, height: int) -> None:
        self.bench, self.sent = bench, 0
        self.image = np.random.default_rng(1).integers(40, 200, (height, width, 3), np.uint8)
        self.ends = [bench.talk(Image, f"{side}/image_raw") for side in SIDES]
        for side in SIDES:
            bench.outsider.create_subscription(Image, f"{side}/image_matching", lambda message: None, 1)

    def run(self, seconds: float) -> None:
        """Send pairs for a while."""
        for _ in range(round(seconds * RATE_HZ)):
            self.sent += 1
            for end in self.ends:
                end.publish(color(self.image, round(self.sent * SECOND / RATE_HZ)))
            self.bench.spin_for(1 / RATE_HZ)


def held(depth: int, stops: int, size: tuple[int, int], folder: Path) -> list[float]:
    """Private memory of the node, MB: before the first stop and after each."""
    bench = Bench()
    graph = Graph(bench, folder, ROS_PYTHON_CHECK_FIELDS="0")
    depths = [a for s in SIDES for a in ("-p", f"qos_overrides./{s}/image_raw.subscription.depth:={depth}")]
    try:
        cameras = Cameras(bench, *size)
        node = graph.start(NODE, "--ros-args", "--params-file", NAVIGATION, *depths)
        bench.connected(*cameras.ends)
        cameras.run(SETTLE_S)
        seen = [usage(node.process.pid).private_mb]
        for _ in range(stops):
            node.signal(signal.SIGSTOP)
            cameras.run(STOPPED_S)
            node.signal(signal.SIGCONT)
            cameras.run(ALONE_S)
            seen.append(usage(node.process.pid).private_mb)
        return seen
    finally:
        graph.end()
        bench.close()


def main() -> int:
    """Print a line for each depth; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--depths", nargs="+", type=int, default=[5, 1])
    parser.add_argument("--stops", type=int, default=6)
    parser.add_argument("--size", default="640x480")
    args = parser.parse_args()
    width, height = map(int, args.size.split("x"))
    print("depth  at start  after each stop, MB  (full queues hold, MB)")
    for depth in args.depths:
        with tempfile.TemporaryDirectory(prefix="uw_recon_queues_") as folder:
            start, *after = held(depth, args.stops, (width, height), Path(folder))
        full = len(SIDES) * depth * width * height * 3 / 1e6
        print(f"{depth:5d}  {start:8.1f}  {' '.join(f'{mb:.1f}' for mb in after)}  ({full:.1f})", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
