"""How time and memory grow with pixels, with labels and with threads, and what inputs made to be hard cost.

    python test/benchmark/match_growth.py [--efforts navigation balanced] [--output bench_out]

Sizes are cones, resized, at 64 labels; labels are searched on cones as it is (450 x 375). Hard inputs are of that size,
with 60 labels: how many cuts are tried, and their time over that of teddy's. Each size in a process of its own.
Prints Markdown tables, leaves ``match_growth.json``.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import match_tables
import numpy as np
from drowned_pairs import STEREO, Image, pairs
from matching import peak_mb
from peers import METHODS, ROOT

from uw_recon_ros.match.methods import EFFORTS
from uw_recon_ros.match.planes import refinement
from uw_recon_ros.match.planes.matcher import graph_cut

SIZES = ((160, 120), (320, 240), (640, 480), (1280, 960))
LABELS = (16, 32, 64, 128, 256)
SHAPE = (375, 450)
PEER = "SGBM 3WAY"
Row = dict[str, Any]


def cones() -> tuple[Image, Image]:
    """The pair as it is."""
    truth = next(pair for pair in pairs() if pair.name == "cones")
    return truth.left, truth.right


def grow(method: str, width: int, height: int, labels: int, threads: int) -> Row:
    """One size and number of labels, in this process."""
    left, right = (cv2.resize(side, (width, height), interpolation=cv2.INTER_AREA) for side in cones())
    matcher = METHODS[method](threads)
    matcher(left[:48, :64].copy(), right[:48, :64].copy(), 8)
    before, best = peak_mb(), (float("inf"), float("inf"))
    for _ in range(2 if width < 1000 else 1):
        cpu, wall = time.process_time(), time.perf_counter()
        matcher(left, right, labels)
        best = min(best, (time.process_time() - cpu, time.perf_counter() - wall))
    return {"method": method, "width": width, "height": height, "labels": labels, "threads": threads,
            "cpu_s": best[0], "wall_s": best[1], "memory_mb": peak_mb() - before}  # fmt: skip


def hard_inputs() -> Iterator[tuple[str, Image, Image]]:
    """Pairs with nothing to match, or too much."""

    def noise(sigma: float, seed: int, grain: float = 0.0) -> Image:
        values = np.random.default_rng(seed).normal(0, 1, SHAPE)
        values = cv2.GaussianBlur(values, (0, 0), grain) if grain else values
        return np.clip(np.round(110 + sigma * values / values.std()), 0, 255).astype(np.uint8)

    def constant(value: int) -> Image:
        return np.full(SHAPE, value, np.uint8)

    stripes = np.tile((127 + 60 * np.sin(np.arange(SHAPE[1]) * 2 * np.pi / 8)).astype(np.uint8), (SHAPE[0], 1))
    teddy = next(pair for pair in pairs() if pair.name == "teddy")
    yield "teddy", teddy.left, teddy.right
    yield "empty wall", constant(110), constant(110)
    yield "saturated", constant(255), constant(255)
    yield "faint noise", noise(1, 1), noise(1, 2)
    yield "strong noise", noise(30, 1), noise(30, 2)
    yield "two unrelated textures", noise(40, 1, 1.5), noise(40, 2, 1.5)
    yield "two unrelated clouds", noise(40, 1, 12), noise(40, 2, 12)
    yield "stripes, the same in both cameras", stripes, stripes
    yield (
        "stripes and noise",
        *(np.clip(stripes + noise(4, s).astype(float) - 110, 0, 255).astype(np.uint8) for s in (1, 2)),
    )


def hard(effort: str) -> list[Row]:
    """All hard inputs, in this process: CPU time and how many planes are tried by cuts at most."""
    tried: list[int] = []
    real = refinement.run_tiles

    def counted(tiles: Any, way: int, planes: int, cut: bool, *others: Any) -> None:
        tried.append(len(tiles) * planes * cut)
        real(tiles, way, planes, cut, *others)

    refinement.run_tiles = counted
    small = np.zeros((48, 64, 3), np.uint8)
    rows: list[Row] = []
    for channels in (small, small[..., 0]):
        graph_cut(channels, channels, 0, 8, effort=effort)
    for name, left, right in hard_inputs():
        tried.clear()
        cpu = time.process_time()
        result = graph_cut(left, right, 0, 59, effort=effort)
        cpu = time.process_time() - cpu
        density = 100 * float((result.status == 0).mean())
        over = cpu / (rows[0]["cpu_s"] if rows else cpu)
        rows.append({"effort": effort, "input": name, "cpu_s": cpu, "over_teddy": over, "planes": sum(tried),
                     "density_percent": density})  # fmt: skip
    refinement.run_tiles = real
    return rows


def main() -> int:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=ROOT / "bench_out")
    parser.add_argument("--efforts", nargs="+", default=["navigation", "balanced"], choices=EFFORTS)
    args = parser.parse_args()
    if not STEREO.is_dir():
        sys.stderr.write(f"{STEREO}: expected the Middlebury pairs, got nothing\n")
        return 1
    jobs = [(*size, 64) for size in SIZES] + [(SHAPE[1], SHAPE[0], n) for n in LABELS] + [(1280, 960, 128)]
    growth, difficult = [], []
    context = multiprocessing.get_context("spawn")
    for method in [f"graph_cut {effort}" for effort in args.efforts] + [PEER]:
        for job in jobs:
            for threads in (1, 2):
                with context.Pool(1) as pool:
                    growth.append(pool.apply(grow, (method, *job, threads)))
        sys.stderr.write(f"{method}: done\n")
    for effort in args.efforts:
        with context.Pool(1) as pool:
            difficult += pool.apply(hard, (effort,))
    args.output.mkdir(parents=True, exist_ok=True)
    result = {"growth": growth, "hard": difficult}
    (args.output / "match_growth.json").write_text(json.dumps(result, indent=1))
    sys.stdout.write(f"{match_tables.growth(growth)}\n\n{match_tables.hard_inputs(difficult)}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
