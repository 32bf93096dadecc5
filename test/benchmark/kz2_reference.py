"""The reference matcher on the four Middlebury pairs: energy against the reference's, errors, time, memory.

    python test/benchmark/kz2_reference.py [--threads 1 2] [--seeds 3] [--output bench_out] [--stereo FOLDER]

Every pair and number of threads runs in a process of its own, compiled code warm. Errors are in percent of the
non-occluded pixels, holes filled, as the benchmark counts; the density is that before filling. Prints a table, leaves
``kz2_reference.json``.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import resource
import statistics
import sys
import time
from pathlib import Path
from typing import Any

from uw_recon_ros.evaluate import evaluate
from uw_recon_ros.files.disparities import read_disparity
from uw_recon_ros.files.images import read_image
from uw_recon_ros.match.kz2.energy import energy
from uw_recon_ros.match.kz2.matcher import kz2

ROOT = Path(__file__).parents[2]

#: Labels, least energy of a C++ implementation (four sweeps, best of three seeds) and its CPU seconds.
REFERENCE = {
    "tsukuba": (16, -12801443, 2.8),
    "venus": (20, -22784723, 8.7),
    "teddy": (60, -146671988, 18.5),
    "cones": (60, -111174470, 13.1),
}
COLUMNS = ("pair", "threads", "seed", "energy", "gap_percent", "bad_0.5", "bad_1", "bad_2", "density_percent",
           "cpu_s", "reference_cpu_s", "wall_s", "memory_mb")  # fmt: skip


def peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024


def run_pair(folder: Path, threads: int, seeds: int) -> list[dict[str, Any]]:
    """Match one pair with several seeds."""
    left, right = (read_image(folder / f"{side}.png") for side in ("left", "right"))
    truth, mask = read_disparity(folder / "gt.pfm"), read_image(folder / "mask_nonocc.png") == 255
    labels, reference, reference_cpu = REFERENCE[folder.name]
    kz2(left[:64, :64], right[:64, :64], 0, 3, sweeps=1, threads=threads)
    before = peak_mb()
    rows = []
    for seed in range(seeds):
        cpu, wall = time.process_time(), time.perf_counter()
        result = kz2(left, right, 0, labels - 1, seed=seed, threads=threads)
        cpu, wall = time.process_time() - cpu, time.perf_counter() - wall
        memory = peak_mb() - before if seed == 0 else rows[0]["memory_mb"]  # later ones hold the evaluation's
        assert result.energy == energy(left, right, result.labels, result.constants)
        errors = evaluate(result.disparity, truth, mask)
        bad = [errors.filled.bad_percent[name] for name in ("bad-0.5", "bad-1", "bad-2")]
        values = (folder.name, threads, seed, result.energy, 100 * (1 - result.energy / reference), *bad,
                  errors.density_percent, cpu, reference_cpu, wall, memory)  # fmt: skip
        rows.append(dict(zip(COLUMNS, values, strict=True)) | {"energies": result.energies})
    return rows


def as_table(rows: list[dict[str, Any]]) -> str:
    """Markdown."""
    lines = ["| " + " | ".join(COLUMNS) + " |", "|" + " --- |" * len(COLUMNS)]
    for row in rows:
        cells = (
            f"{row[c]:.{4 if c == 'gap_percent' else 2}f}" if isinstance(row[c], float) else row[c] for c in COLUMNS
        )
        lines.append("| " + " | ".join(str(cell) for cell in cells) + " |")
    return "\n".join(lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--stereo", type=Path, default=ROOT.parent / "shared" / "data" / "stereo")
    parser.add_argument("--output", type=Path, default=ROOT / "bench_out")
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--seeds", type=int, default=3)
    args = parser.parse_args()
    if not args.stereo.is_dir():
        sys.stderr.write(f"{args.stereo}: expected the Middlebury pairs, got nothing\n")
        return 1
    rows: list[dict[str, Any]] = []
    for threads in args.threads:
        for name in REFERENCE:
            with multiprocessing.get_context("spawn").Pool(1) as pool:
                rows += pool.apply(run_pair, (args.stereo / name, threads, args.seeds))
            of_pair = rows[-args.seeds :]
            gap = statistics.median(row["gap_percent"] for row in of_pair)
            sys.stderr.write(f"{name}, {threads} threads: median gap {gap:.4f} %\n")
    args.output.mkdir(parents=True, exist_ok=True)
    (args.output / "kz2_reference.json").write_text(json.dumps(rows, indent=1))
    sys.stdout.write(as_table(rows) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
