"""Whether the nodes hold what they hold at the start after hours of work: memory, threads, files, shared memory.

Usage: python test/benchmark/graph_soak.py [--pairs 20000] [--minutes 60] [--every 500] [--full-size] [--composed]
       [--one-process] [--output FILE.json]

Small images of known depth go through the four nodes, each a process (``--composed``: through ``pipeline_node``), as
fast as they are taken, until so many pairs or minutes are over. ``--full-size``: a simulated dive of 640x480, played in
a loop at 10 Hz to nodes with ``config/navigation.yaml``; pairs are then clouds that came. MB are private memory
(resident, without shared libraries and segments). ``--one-process``: cameras, ``pipeline_node`` and listener in this
process, without transport between processes: the most pairs a second.
"""

# ruff: noqa: T201, E402

from __future__ import annotations

import argparse
import dataclasses
import json
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

sys.path[:0] = [str(Path(__file__).resolve().parent.parent), str(Path(__file__).resolve().parent)]

from uw_recon_ros.blas import one_blas_thread

one_blas_thread()  # as the executables do

from graph_load import NAVIGATION, Heard, Sea
from helpers.graph_bench import FOUR, Bench, Graph
from helpers.sea_trial import PARAMETERS, SeaTrial, arguments
from helpers.soak import Sample, growth_kb, sample, soak

from uw_recon_ros.nodes.pipeline_node import PipelineNode
from uw_recon_ros.ros import allocator

FULL_SIZE, FRAMES = (640, 480), 40
WATCH_INTERVAL = 50  # as in navigation.yaml: watching the rig takes longer than a small pair


def show(sample: Sample, seconds: float) -> None:
    """Print a line of the table."""
    nodes = "   ".join(f"{u.private_mb:7.1f} MB {u.threads:3d} {u.files:3d}" for u in sample.nodes.values())
    print(f"{sample.pairs:6d} {seconds:7.0f} s   {nodes}   {sample.segments:4d}", flush=True)


def as_processes(graph: Graph, nodes: tuple[str, ...]) -> dict[str, int]:
    """The nodes as processes."""
    return {name: graph.start(name, *arguments(watch_interval=WATCH_INTERVAL)).process.pid for name in nodes}


def within(graph: Graph) -> dict[str, int]:
    """``pipeline_node`` in this process."""
    graph.bench.start(PipelineNode, **PARAMETERS, watch_interval=WATCH_INTERVAL)
    return {"pipeline_node": os.getpid()}


def small(graph: Graph, pids: dict[str, int], pairs: int, every: int) -> Iterator[Sample]:
    """Small pairs, each when the one before the last has come through."""
    nodes = tuple(pids)
    trial = SeaTrial(graph, nodes)
    trial.connected()
    trial.sails()
    yield from soak(trial, pids, pairs, every)
    trial.sails()


def full_size(graph: Graph, nodes: tuple[str, ...], folder: Path, pairs: int, every: int) -> Iterator[Sample]:
    """A dive in a loop at 10 Hz; the nodes take what they can."""
    sea, heard = Sea(folder / "sea", *FULL_SIZE, FRAMES), Heard()
    heard.listen(graph.bench)
    limits = ["-p", "min_disparity:=0", "-p", "max_disparity:=63"]
    given = ["--ros-args", "--params-file", NAVIGATION, *limits]
    pids = {name: graph.start(name, *given).process.pid for name in nodes}
    graph.ready(*nodes)
    graph.start("bag_player_node", sea.path, "--loop")
    came = 0
    while came < pairs:
        graph.spin_until(lambda: heard.clouds, "a cloud")
        for kept in (heard.clouds, heard.depths, heard.sent):
            kept.clear()
        came += 1
        if came % every == 0:
            yield sample(pids, came)


def main() -> None:
    """Run, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=20_000)
    parser.add_argument("--minutes", type=float, default=float("inf"))
    parser.add_argument("--every", type=int, default=500)
    parser.add_argument("--full-size", action="store_true")
    parser.add_argument("--composed", action="store_true", help="pipeline_node in place of the four")
    parser.add_argument("--one-process", action="store_true", help="pipeline_node in this process")
    parser.add_argument("--output", type=Path)
    args = parser.parse_args()
    allocator.keep_freed_memory()
    nodes = ("pipeline_node",) if args.composed or args.one_process else FOUR
    samples: list[Sample] = []
    with tempfile.TemporaryDirectory(prefix="uw_recon_soak_") as folder:
        bench = Bench()
        graph = Graph(bench, Path(folder), ROS_PYTHON_CHECK_FIELDS="0")  # as users run them
        if args.full_size:
            taken = full_size(graph, nodes, Path(folder), args.pairs, args.every)
        else:
            pids = within(graph) if args.one_process else as_processes(graph, nodes)
            taken = small(graph, pids, args.pairs, args.every)
        try:
            print(" pairs      time   " + "   ".join(f"{name:>18s}" for name in nodes) + "   segments")
            print(" " * 20 + "   ".join(f"{'private thr fds':>18s}" for _ in nodes))
            started = time.monotonic()
            for seen in taken:
                samples.append(seen)
                show(seen, time.monotonic() - started)
                if time.monotonic() - started > 60 * args.minutes:
                    break
        finally:
            graph.end()
            bench.close()
    settled = samples[len(samples) // 4 :]
    print(f"{samples[-1].pairs if samples else 0} pairs")
    growth = {name: growth_kb(settled, name) for name in nodes} if len(settled) > 1 else {}
    print("growth, kB a pair: " + ", ".join(f"{name} {value:+.3f}" for name, value in growth.items()))
    if args.output:
        result = {"samples": [dataclasses.asdict(s) for s in samples], "growth_kb_a_pair": growth}
        args.output.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
