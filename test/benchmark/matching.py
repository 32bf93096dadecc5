"""Every matcher and its peers on the Middlebury pairs, in air and drowned: errors, occlusions, energy, time, memory.

    python test/benchmark/matching.py [--threads 1 2] [--waters air hazy snow] [--methods ...] [--output bench_out]

Each matcher runs in a process of its own for every water and number of threads, compiled code warm, three times a pair
(slow ones once); the least times count. Errors are in percent of the non-occluded pixels, holes filled, as the
benchmark counts; the density is that before filling; occlusions found are the pixels that the status calls seen by one
camera alone (for the peers, which do not say why, all without a disparity), against the truth's. Prints the tables,
leaves ``matching.json``, ``matching.md`` and ``accuracy_over_time.svg``.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import resource
import sys
import time
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from drowned_pairs import STEREO, WATERS, Image, Truth, drown, pairs
from match_plot import accuracy_over_time
from match_tables import everything, summary
from numpy.typing import NDArray
from peers import METHODS, ROOT, SLOW, Found, Matcher, available

from uw_recon_ros.evaluate import evaluate

REPEATS = 3
Row = dict[str, Any]


def snow(left: Image, right: Image) -> tuple[Image, Image]:
    """Particles before the lens, different in either camera, and the right camera exposed differently."""
    rng = np.random.default_rng(5)
    sides = []
    for image, gain, offset in ((left, 1.0, 0.0), (right, 0.85, 9.0)):
        layer = np.zeros(image.shape[:2], np.float32)
        for _ in range(image.size // 9000):
            v, u = (int(rng.integers(n)) for n in layer.shape)
            cv2.circle(layer, (u, v), int(rng.integers(1, 4)), float(rng.uniform(15, 70)), -1)
        seen = image * gain + offset + cv2.GaussianBlur(layer, (0, 0), 0.8)[..., None]
        sides.append(np.clip(np.round(seen), 0, 255).astype(np.uint8))
    return sides[0], sides[1]


def wet(truth: Truth, water: str) -> tuple[Image, Image]:
    """The pair under water; ``snow`` is haze with particles."""
    return snow(*drown(truth, WATERS["hazy"])) if water == "snow" else drown(truth, WATERS[water])


def peak_mb() -> float:
    """Of this process."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def timed(matcher: Matcher, left: Image, right: Image, labels: int, repeats: int) -> tuple[Found, float, float]:
    """What is found, and the least wall and CPU seconds."""
    walls, cpus = [], []
    for _ in range(repeats):
        cpu, wall = time.process_time(), time.perf_counter()
        found = matcher(left, right, labels)
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - cpu)
        if found.spent:
            return found, found.spent[0], found.spent[1]
    return found, min(walls), min(cpus)


def run(method: str, water: str, threads: int) -> list[Row]:
    """One matcher on all pairs, in this process."""
    matcher = METHODS[method](threads)
    rows = []
    for truth in pairs():
        left, right = wet(truth, water)
        if not rows:
            matcher(left[:48, :64].copy(), right[:48, :64].copy(), 8)
            before = peak_mb()
        found, wall, cpu = timed(matcher, left, right, truth.max_disparity, 1 if method in SLOW else REPEATS)
        memory = found.spent[2] if found.spent else peak_mb() - before
        rows.append({
            "method": method, "pair": truth.name, "water": water, "threads": threads, "wall_s": wall, "cpu_s": cpu,
            "memory_mb": memory, "energy": None if np.isnan(found.energy) else found.energy, **judged(found, truth),
        })  # fmt: skip
    return rows


def judged(found: Found, truth: Truth) -> Row:
    """How good a result is."""
    disparity = found.disparity
    errors = evaluate(disparity, truth.disparity, truth.mask)
    seen, counted = (
        cv2.imread(str(STEREO / truth.name / f"mask_{name}.png"), cv2.IMREAD_GRAYSCALE) == 255
        for name in ("nonocc", "all")
    )
    occluded = ~np.isfinite(disparity) if found.occluded is None else found.occluded
    hidden, empty = counted & ~seen, counted & occluded
    hits = float((hidden & empty).sum())
    return {
        **{f"bad_{x}": errors.filled.bad_percent[f"bad-{x}"] for x in ("0.5", "1", "2")},
        "density_percent": errors.density_percent,
        "within_sigma_percent": within(found.sigma, disparity - truth.disparity, truth.mask),
        "occlusion_precision": hits / max(empty.sum(), 1), "occlusion_recall": hits / max(hidden.sum(), 1),
    }  # fmt: skip


def within(sigma: NDArray[np.float32] | None, error: NDArray[np.float32], mask: NDArray[np.bool_]) -> float | None:
    """Share of the errors smaller than sigma, %: 68 where it is honest."""
    known = mask & np.isfinite(error)
    return None if sigma is None else float(100 * (np.abs(error) <= sigma)[known].mean())


def main() -> int:
    """Run what is asked for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=ROOT / "bench_out")
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--waters", nargs="+", default=["air", "hazy", "noisy", "uneven", "snow"])
    parser.add_argument("--methods", nargs="+", default=list(METHODS), choices=list(METHODS))
    args = parser.parse_args()
    if not STEREO.is_dir():
        sys.stderr.write(f"{STEREO}: expected the Middlebury pairs, got nothing\n")
        return 1
    rows: list[Row] = []
    for water in args.waters:
        for threads in args.threads if water == "air" else args.threads[-1:]:
            for method in available(args.methods):
                with multiprocessing.get_context("spawn").Pool(1) as pool:
                    rows += (new := pool.apply(run, (method, water, threads)))
                sys.stderr.write(summary(new).splitlines()[-1] + "\n")
    args.output.mkdir(parents=True, exist_ok=True)
    (args.output / "matching.json").write_text(json.dumps(rows, indent=1))
    text = everything(rows)
    (args.output / "matching.md").write_text(text)
    (args.output / "accuracy_over_time.svg").write_text(accuracy_over_time(rows))
    sys.stdout.write(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
