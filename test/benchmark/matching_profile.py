"""Where the time of the graph-cut matcher goes: CPU time of every step on one thread, by size of the images.

    python test/benchmark/matching_profile.py [--effort balanced] [--output bench_out]

Teddy at 450x375 with 60 labels, and a simulated reef at 640x480 with 64 and 1280x960 with 128. The steps of the whole
matcher are timed in place. What happens inside the moves is timed in a second run, whose tiles are worked off from
Python, kernel by kernel, and scaled to the first. "shared" is the part that several threads share: with n of them, the
wall time is at best ``CPU * (1 - shared + shared / n)``. Prints tables, leaves ``matching_profile.json``.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from drowned_pairs import pairs
from numpy.typing import NDArray
from simulated_frames import rectified_frames

from uw_recon_ros.match.planes import (
    disparity_sigma,
    expansion,
    initial_disparity,
    matcher,
    refinement,
    semiglobal,
)

ROOT = Path(__file__).parents[2]
Scene = tuple[NDArray[np.uint8], NDArray[np.uint8], int, int]
SHARED = "shared by threads"
#: Steps, by the module that calls them; indented: parts of the one above.
STEPS: tuple[tuple[str, Any, str], ...] = (
    ("gray images", initial_disparity.View, "pair"),
    ("start", initial_disparity, "_start"),
    ("  census words", semiglobal, "census_words"),
    ("  cost volume", semiglobal, "_volume"),
    ("  aggregation", semiglobal, "aggregate"),
    ("  left/right check", initial_disparity, "compare_views"),
    ("blank regions", matcher, "untextured_mask"),
    ("view: samples, arms", matcher, "_view"),
    ("edge weights", matcher, "edge_weights"),
    ("moves", matcher, "refine"),
    ("enforce_uniqueness", matcher, "enforce_uniqueness"),
    ("islands", matcher, "remove_small_segments"),
    ("sigma", matcher, "sigma_of"),
)
INSIDE: tuple[tuple[str, Any, str], ...] = (
    ("  planes proposed", refinement, "propose"),
    ("  costs of planes", refinement, "plane_cost"),
    ("  cheaper planes taken", refinement, "take_cheaper"),
    ("  gain estimated", refinement, "possible_gain"),
    ("  graphs built", expansion, "_build"),
    ("  minimum cuts", expansion, "cut"),
)


def scenes() -> Iterator[tuple[str, Scene]]:
    """Name, and left, right, least and greatest disparity."""
    for truth in pairs():
        if truth.name == "teddy":
            yield "450x375x60", (truth.left, truth.right, 0, truth.max_disparity - 1)
    for width, height, low in ((640, 480, 22), (1280, 960, 44)):
        frame = rectified_frames(1, scene="reef", width=width, height=height)[0]
        labels = width // 10
        yield f"{width}x{height}x{labels}", (frame.left, frame.right, low, low + labels - 1)


class Clock:
    """CPU seconds and calls by name."""

    def __init__(self) -> None:
        self.seconds: dict[str, float] = {}
        self.calls: dict[str, int] = {}

    def around(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """The function, timed."""

        def timed(*args: Any, **options: Any) -> Any:
            started = time.process_time()
            try:
                return function(*args, **options)
            finally:
                self.seconds[name] = self.seconds.get(name, 0.0) + time.process_time() - started
                self.calls[name] = self.calls.get(name, 0) + 1

        return timed

    @contextmanager
    def on(self, steps: tuple[tuple[str, Any, str], ...]) -> Iterator[None]:
        """Have some steps timed."""
        with ExitStack() as stack:
            for title, owner, name in steps:
                stack.enter_context(patch.object(owner, name, self.around(title, getattr(owner, name))))
            yield


def expand_from_python(
    a: float, b: float, c: float, top: int, bottom: int, left: int, right: int, cost: Any, state: Any, grid: Any
) -> int:
    """`expansion.expand`, its kernels called one by one."""
    row = right - left + 2
    nodes = row * (bottom - top + 2)
    expansion.clear(grid, nodes)
    expansion._build(a, b, c, top, bottom, left, right, cost, state, grid, nodes, row)
    if not expansion.cut(grid, nodes, row, expansion.MOST_STEPS * nodes):
        return 0
    moved = grid.tree[:nodes].reshape(-1, row)[1:-1, 1:-1] == expansion.MOVE
    for i, x in enumerate((a, b, c)):
        state.planes[i, top:bottom, left:right][moved] = x
    state.costs[top:bottom, left:right][moved] = cost[: bottom - top, : right - left][moved]
    return int(moved.sum())


def profile(scene: Scene, effort: str) -> tuple[float, Clock]:
    """CPU seconds of all, and of the steps."""
    left, right, low, high = scene
    small = left[:64, :96].copy(), right[:64, :96].copy()
    clock, inside = Clock(), Clock()
    modules = (matcher, semiglobal, refinement, disparity_sigma, initial_disparity)
    shared = tuple((SHARED, module, "run_parallel") for module in modules)
    matcher.graph_cut(*small, 0, 7, effort=effort)  # compiles
    started = time.process_time()
    with clock.on((*STEPS, *shared)):
        matcher.graph_cut(left, right, low, high, effort=effort)
    total = time.process_time() - started
    slow: Any = refinement.run_tiles
    tiles = patch.object(refinement, "run_tiles", slow.py_func), patch.object(refinement, "expand", expand_from_python)
    with tiles[0], tiles[1]:
        matcher.graph_cut(*small, 0, 7, effort=effort)
    with inside.on(INSIDE), tiles[0], tiles[1]:
        matcher.graph_cut(left, right, low, high, effort=effort)
    part = clock.seconds.get("moves", 0.0) / max(sum(inside.seconds.values()), 1e-9)
    clock.seconds |= {name: seconds * part for name, seconds in inside.seconds.items()}
    clock.calls |= inside.calls
    return total, clock


def table(name: str, total: float, clock: Clock) -> str:
    """One line a step."""
    lines = [f"{name}: {total:.3f} CPU s, {100 * clock.seconds[SHARED] / total:.0f} % shared", ""]
    lines += ["| step | CPU s | % | calls |", "| --- | --- | --- | --- |"]
    titles = [title for title, *_ in STEPS]
    at = titles.index("moves") + 1
    for title in titles[:at] + [title for title, *_ in INSIDE] + titles[at:]:
        if seconds := clock.seconds.get(title, 0.0):
            shown = title.replace("  ", "&nbsp;&nbsp;")
            lines.append(f"| {shown} | {seconds:.3f} | {100 * seconds / total:.1f} | {clock.calls[title]} |")
    return "\n".join(lines) + "\n"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--effort", default="balanced", choices=tuple(matcher.SCHEDULES))
    parser.add_argument("--output", type=Path, default=ROOT / "bench_out")
    args = parser.parse_args()
    found = {}
    for name, scene in scenes():
        total, clock = profile(scene, args.effort)
        found[name] = {"cpu_s": total, "steps_cpu_s": clock.seconds, "calls": clock.calls}
        sys.stdout.write(table(name, total, clock) + "\n")
    args.output.mkdir(parents=True, exist_ok=True)
    (args.output / "matching_profile.json").write_text(json.dumps(found, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
