"""Whether the four nodes hold what they hold at the start after an hour's work: memory, threads, files, shared memory.

Usage: python test/benchmark/graph_soak.py [--pairs 20000] [--every 500] [--output FILE.json]

Small images of known depth go through the four nodes, each a process, as fast as they are taken; 20,000 pairs are an
hour at 5.6 Hz. MB are private memory (resident, without shared libraries and segments).
"""

# ruff: noqa: T201

from __future__ import annotations

import argparse
import dataclasses
import json
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from helpers.graph_bench import FOUR, Bench, Graph
from helpers.sea_trial import SeaTrial, arguments
from helpers.soak import Sample, growth_kb, soak


def show(sample: Sample, seconds: float) -> None:
    """Print a line of the table."""
    nodes = "   ".join(f"{u.private_mb:7.1f} MB {u.threads:3d} {u.files:3d}" for u in sample.nodes.values())
    print(f"{sample.pairs:6d} {seconds:7.0f} s   {nodes}   {sample.segments:4d}", flush=True)


def main() -> None:
    """Run, print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--pairs", type=int, default=20_000)
    parser.add_argument("--every", type=int, default=500)
    parser.add_argument("--output", type=Path)
    args = parser.parse_args()
    samples: list[Sample] = []
    with tempfile.TemporaryDirectory(prefix="uw_recon_soak_") as folder:
        bench = Bench()
        graph = Graph(bench, Path(folder))
        try:
            pids = {name: graph.start(name, *arguments()).process.pid for name in FOUR}
            trial = SeaTrial(graph)
            trial.connected()
            trial.sails()
            print(" pairs      time   " + "   ".join(f"{name:>18s}" for name in FOUR) + "   segments")
            print(" " * 20 + "   ".join(f"{'private thr fds':>18s}" for _ in FOUR))
            started = time.monotonic()
            for sample in soak(trial, pids, args.pairs, args.every):
                samples.append(sample)
                show(sample, time.monotonic() - started)
            trial.sails()
        finally:
            graph.end()
            bench.close()
    settled = samples[len(samples) // 4 :]
    growth = {name: growth_kb(settled, name) for name in FOUR}
    print("growth, kB a pair: " + ", ".join(f"{name} {value:+.3f}" for name, value in growth.items()))
    if args.output:
        result = {"samples": [dataclasses.asdict(s) for s in samples], "growth_kb_a_pair": growth}
        args.output.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
