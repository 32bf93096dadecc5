"""Replay the sample bag through the four nodes, each a process, and show what they publish.

Leaves ``index.html`` in the output folder: raw, enhanced and rectified images, disparity, depth against the truth, a
3-D view, and a table of times, densities and errors, which is printed too. Beside it ``cloud.ply`` and ``mesh.glb`` of
one frame, and ``topics``, a bag of what the nodes published.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path

import rclpy
from collect import Collector
from frames import Frame, Truth, read_frame
from graph import NODES, Graph
from page import print_table, typical, write_demo_page, write_files, write_topics
from rclpy.context import Context
from rclpy.signals import SignalHandlerOptions

from uw_recon_ros.bags.reader import open_bag
from uw_recon_ros.pipeline import Pipeline, PipelineParams
from uw_recon_ros.progress import say
from uw_recon_ros.ros import fastdds
from uw_recon_ros.types import StereoPair

ROOT = Path(__file__).resolve().parent.parent
NAME_SPACE = "/uw_demo"
CAMERAS = [f"/{side}/{topic}" for side in ("left", "right") for topic in ("image_raw", "camera_info")]
_WAIT_S = 120.0


def arguments() -> argparse.Namespace:
    """Parse the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--bag", type=Path, default=ROOT / "bags" / "amphora", help="default: %(default)s")
    parser.add_argument("--output", type=Path, default=Path("demo_out"), help="default: %(default)s")
    return parser.parse_args()


def compile_kernels(pair: StereoPair) -> None:
    """Run the stages once here: compiled code is cached, so that four processes need not each wait for it."""
    started = time.monotonic()
    say("[1/4] compiling kernels: about a minute at first, then kept ...")
    products = Pipeline(PipelineParams())(pair)
    _ = products.thinned, products.surface
    say(f"      done in {time.monotonic() - started:.0f} s")


def raw_pairs(bag: Path) -> dict[int, StereoPair]:
    """The stereo pairs of a bag by stamp."""
    with open_bag(bag) as reader:
        return {pair.stamp_ns: pair for pair in reader.stereo_pairs()}


def replay(graph: Graph, collector: Collector, args: argparse.Namespace, expected: int) -> None:
    """Play the bag frame by frame, each when the one before has come through: a slow machine loses none."""
    wait(graph, lambda: collector.diagnostics.keys() >= set(NODES), collector)
    graph.start("bag_player_node", str(args.bag), "--start-paused", "--wait-for", *CAMERAS)
    for number in range(1, expected + 1):
        collector.step()
        wait(graph, lambda n=number: len(collector.complete()) >= n, collector)
        say(f"      {number} of {expected} frames")
    collector.spin(1.5)  # a last round of diagnostics


def wait(graph: Graph, until: Callable[[], bool], collector: Collector) -> None:
    """Receive until something is so; end the demo where a node has ended, or it takes too long."""
    started = time.monotonic()
    while not until():
        collector.spin(0.1)
        if dead := [name for name in graph.dead() if name in NODES]:
            raise SystemExit(f"demo: {dead[0]} ended; its last words:\n{graph.log(dead[0])[-2000:]}")
        if time.monotonic() - started > _WAIT_S:
            raise SystemExit(f"demo: nothing came for {_WAIT_S:.0f} s; the nodes' logs are in {graph.logs}")


def files_to_open(output: Path, page: Path) -> str:
    """Say what was left, where, and what opens it."""
    return (
        f"  {page}   every stage, numbers and a 3-D view: any browser\n"
        f"  {output / 'cloud.ply'}    one frame's points: CloudCompare, MeshLab\n"
        f"  {output / 'mesh.glb'}     its textured surface: Blender, any glTF viewer\n"
        f"  {output / 'topics'}/      a bag of all the nodes' topics: Foxglove, ros2 bag play"
    )


def main() -> int:
    """Run the demo; return the exit code."""
    args = arguments()
    started = time.monotonic()
    args.output.mkdir(parents=True, exist_ok=True)
    os.environ.setdefault("ROS_LOG_DIR", str((args.output / "log").resolve()))
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    raw = raw_pairs(args.bag)
    expected = len(raw)
    truth = Truth.read(args.bag)
    compile_kernels(next(iter(raw.values())))

    if warning := fastdds.prepare():
        say(f"      {warning}")
    context = Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    (args.output / "log").mkdir(exist_ok=True)
    say(f"[2/4] starting {', '.join(NODES)}")
    try:
        with Graph(args.output / "log", ["-r", f"__ns:={NAME_SPACE}"]) as graph:
            collector = Collector(context, NAME_SPACE)
            say(f"[3/4] replaying {args.bag.name}: {expected} stereo pairs over DDS")
            replay(graph, collector, args, expected)
            collector.close()
    finally:
        rclpy.try_shutdown(context=context)

    frames: list[Frame] = [read_frame(s, collector.frames[s], truth) for s in collector.complete()]
    if not frames:
        raise SystemExit(f"demo: expected {expected} frames, got none whole; the nodes' logs are in {args.output}/log")
    say("[4/4] writing the page, the cloud, the mesh and the bag")
    page = write_demo_page(args.output / "index.html", frames, raw, collector)
    write_files(args.output, typical(frames))
    write_topics(args.output / "topics", [frame.stamp_ns for frame in frames], collector)
    print_table(frames, expected, collector)
    say(f"done in {time.monotonic() - started:.0f} s; open\n" + files_to_open(args.output, page))
    return 0 if len(frames) == expected else 1


if __name__ == "__main__":
    sys.exit(main())
