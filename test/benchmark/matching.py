"""Every matcher and its peers on the Middlebury pairs, in air and drowned: errors, occlusions, time, memory.

    python test/benchmark/matching.py [--threads 1 2] [--waters air hazy snow] [--methods ...] [--output bench_out]

Each matcher runs in a process of its own for every pair, water and number of threads, compiled code warm, three times;
the least times count. Errors are in percent of the non-occluded pixels, holes filled, as the benchmark counts; the
density is that before filling; occlusions found are the pixels without a disparity, against the truth's. Prints two
tables, leaves ``matching.json`` and ``matching.md``.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import resource
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from drowned_pairs import STEREO, WATERS, Image, Truth, drown, pairs
from numpy.typing import NDArray

from uw_recon_ros.evaluate import evaluate
from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.types import RectificationQuality, RectifiedPair, StereoGeometry

ROOT = Path(__file__).parents[2]
REPEATS = 3
GEOMETRY = StereoGeometry(focal_px=500.0, cx_left=0.0, cx_right=0.0, cy=0.0)
Maps = tuple[NDArray[np.float32], NDArray[np.float32] | None]  # disparity, sigma
Matcher = Callable[[Image, Image, int], Maps]


def ours(threads: int, **choice: str) -> Matcher:
    def match(left: Image, right: Image, labels: int) -> Maps:
        pair = RectifiedPair(left, right, left, right, GEOMETRY, RectificationQuality("given"))
        params = MatchParams(min_disparity=0, max_disparity=labels - 1, match_threads=threads, **choice)  # type: ignore[arg-type]
        result = Match(params)(pair)
        return result.disparity, result.sigma

    return match


def sgbm(threads: int, mode: int, pad: bool = True, **settings: int) -> Matcher:
    """OpenCV's; padded on the left, so that it has no dead border there."""

    def match(left: Image, right: Image, labels: int) -> Maps:
        count = -(-labels // 16) * 16
        border = count if pad else 0
        left, right = (cv2.copyMakeBorder(i, 0, 0, border, 0, cv2.BORDER_REPLICATE) for i in (left, right))
        matcher = cv2.StereoSGBM_create(minDisparity=0, numDisparities=count, mode=mode, **settings)
        disparity = matcher.compute(left, right)[:, border:].astype(np.float32) / 16
        return np.where(disparity < 0, np.float32(np.nan), disparity), None

    cv2.setNumThreads(threads)
    return match


TUNED = {"blockSize": 3, "P1": 8 * 27, "P2": 32 * 27, "disp12MaxDiff": 1, "uniquenessRatio": 10,
         "speckleWindowSize": 100, "speckleRange": 2}  # fmt: skip
#: Of disparity_node in stereo_image_proc.
ROS_DEFAULTS = {"blockSize": 15, "P1": 200, "P2": 400, "disp12MaxDiff": 0, "preFilterCap": 31, "uniquenessRatio": 15,
                "speckleWindowSize": 100, "speckleRange": 4}  # fmt: skip

METHODS: dict[str, Callable[[int], Matcher]] = {
    "graph_cut navigation": lambda t: ours(t, method="graph_cut", effort="navigation"),
    "graph_cut balanced": lambda t: ours(t, method="graph_cut", effort="balanced"),
    "graph_cut quality": lambda t: ours(t, method="graph_cut", effort="quality"),
    "kz2": lambda t: ours(t, method="kz2"),
    "SGBM 3WAY": lambda t: sgbm(t, cv2.STEREO_SGBM_MODE_SGBM_3WAY, **TUNED),
    "SGBM HH": lambda t: sgbm(t, cv2.STEREO_SGBM_MODE_HH, **TUNED),
    "stereo_image_proc SGBM": lambda t: sgbm(t, cv2.STEREO_SGBM_MODE_SGBM, pad=False, **ROS_DEFAULTS),
}


def snow(left: Image, right: Image) -> tuple[Image, Image]:
    """Particles before the lens, different in either eye, and the right eye exposed differently."""
    rng = np.random.default_rng(5)
    eyes = []
    for image, gain, offset in ((left, 1.0, 0.0), (right, 0.85, 9.0)):
        layer = np.zeros(image.shape[:2], np.float32)
        for _ in range(image.size // 9000):
            v, u = (int(rng.integers(n)) for n in layer.shape)
            cv2.circle(layer, (u, v), int(rng.integers(1, 4)), float(rng.uniform(15, 70)), -1)
        seen = image * gain + offset + cv2.GaussianBlur(layer, (0, 0), 0.8)[..., None]
        eyes.append(np.clip(np.round(seen), 0, 255).astype(np.uint8))
    return eyes[0], eyes[1]


def wet(truth: Truth, water: str) -> tuple[Image, Image]:
    return snow(*drown(truth, WATERS["hazy"])) if water == "snow" else drown(truth, WATERS[water])


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def run(method: str, name: str, water: str, threads: int) -> dict[str, Any]:
    """One matcher on one pair, in this process."""
    truth = next(pair for pair in pairs() if pair.name == name)
    left, right = wet(truth, water)
    matcher = METHODS[method](threads)
    matcher(left[:48, :64].copy(), right[:48, :64].copy(), 8)
    before = peak_mb()
    walls, cpus = [], []
    for _ in range(1 if method in ("kz2", "graph_cut quality") else REPEATS):
        cpu, wall = time.process_time(), time.perf_counter()
        disparity, sigma = matcher(left, right, truth.max_disparity)
        walls.append(time.perf_counter() - wall)
        cpus.append(time.process_time() - cpu)
    memory = peak_mb() - before
    errors = evaluate(disparity, truth.disparity, truth.mask)
    seen = cv2.imread(str(STEREO / name / "mask_nonocc.png"), cv2.IMREAD_GRAYSCALE) == 255
    counted = cv2.imread(str(STEREO / name / "mask_all.png"), cv2.IMREAD_GRAYSCALE) == 255
    hidden, empty = counted & ~seen, counted & ~np.isfinite(disparity)
    hits = float((hidden & empty).sum())
    return {
        "method": method, "pair": name, "water": water, "threads": threads,
        **{f"bad_{x}": errors.filled.bad_percent[f"bad-{x}"] for x in ("0.5", "1", "2")},
        "density_percent": errors.density_percent, "wall_s": min(walls), "cpu_s": min(cpus), "memory_mb": memory,
        "within_sigma_percent": within(sigma, disparity - truth.disparity, truth.mask),
        "occlusion_precision": hits / max(empty.sum(), 1), "occlusion_recall": hits / max(hidden.sum(), 1),
    }  # fmt: skip


def within(sigma: NDArray[np.float32] | None, error: NDArray[np.float32], mask: NDArray[np.bool_]) -> float:
    """Share of the errors smaller than sigma, %: 68 where it is honest."""
    known = mask & np.isfinite(error)
    return float("nan") if sigma is None else float(100 * (np.abs(error) <= sigma)[known].mean())


def mean(rows: list[dict[str, Any]], key: str) -> float:
    return float(np.mean([row[key] for row in rows])) if rows else float("nan")


def summary(rows: list[dict[str, Any]]) -> str:
    """One line a method, water and number of threads: means over the pairs."""
    lines = [
        "| method | water | threads | bad-0.5 (without tsukuba) | bad-1 | bad-2 | density % | within sigma % | wall s"
        " | CPU s | MB |",
        "|" + " --- |" * 11,
    ]
    for method, water, threads in dict.fromkeys((r["method"], r["water"], r["threads"]) for r in rows):
        of = [r for r in rows if (r["method"], r["water"], r["threads"]) == (method, water, threads)]
        fine = mean([r for r in of if r["pair"] != "tsukuba"], "bad_0.5")
        cells = (
            f"{mean(of, key):.2f}"
            for key in ("bad_1", "bad_2", "density_percent", "within_sigma_percent", "wall_s", "cpu_s")
        )
        memory = max(r["memory_mb"] for r in of)
        lines.append(f"| {method} | {water} | {threads} | {fine:.2f} | {' | '.join(cells)} | {memory:.0f} |")
    return "\n".join(lines)


def details(rows: list[dict[str, Any]]) -> str:
    """One line a run in air."""
    lines = ["| method | pair | threads | bad-0.5 / 1 / 2 | occlusions P / R | wall s | CPU s |", "|" + " --- |" * 7]
    for r in rows:
        if r["water"] == "air":
            bad = " / ".join(f"{r[f'bad_{x}']:.2f}" for x in ("0.5", "1", "2"))
            hidden = f"{r['occlusion_precision']:.2f} / {r['occlusion_recall']:.2f}"
            cells = (r["method"], r["pair"], r["threads"], bad, hidden, f"{r['wall_s']:.3f}", f"{r['cpu_s']:.3f}")
            lines.append("| " + " | ".join(str(c) for c in cells) + " |")
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=ROOT / "bench_out")
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--waters", nargs="+", default=["air", "hazy", "noisy", "uneven", "snow"])
    parser.add_argument("--methods", nargs="+", default=list(METHODS), choices=list(METHODS))
    args = parser.parse_args()
    names = [pair.name for pair in pairs()]
    if not names:
        sys.stderr.write(f"{STEREO}: expected the Middlebury pairs, got nothing\n")
        return 1
    rows: list[dict[str, Any]] = []
    for water in args.waters:
        for threads in args.threads if water == "air" else args.threads[-1:]:
            for method in args.methods:
                for name in names:
                    with multiprocessing.get_context("spawn").Pool(1) as pool:
                        rows.append(pool.apply(run, (method, name, water, threads)))
                sys.stderr.write(summary(rows[-len(names) :]).splitlines()[-1] + "\n")
    args.output.mkdir(parents=True, exist_ok=True)
    (args.output / "matching.json").write_text(json.dumps(rows, indent=1))
    text = f"{summary(rows)}\n\n{details(rows)}\n"
    (args.output / "matching.md").write_text(text)
    sys.stdout.write(text)
    return 0


if __name__ == "__main__":
    sys.exit(main())
