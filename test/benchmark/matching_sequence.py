"""What starting from the frame before brings (``use_previous``): errors and CPU time on simulated dives with truth.

    python test/benchmark/matching_sequence.py [--efforts balanced quality] [--frames 5] [--output bench_out]

Three dives of 640x480, from 2 frames a second with the images moving by 50 px from one to the next, to 5 a second and
10 px. Each frame is matched alone and as the next of its sequence; the first, which has none before it, is left out.
Errors are in percent of the pixels that both cameras see, holes filled; the density is that before filling. Prints a
table, leaves ``matching_sequence.json``.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from simulated_frames import Frame, rectified_frames

from uw_recon_ros.evaluate import evaluate
from uw_recon_ros.match.planes.matcher import GraphCutResult, graph_cut

ROOT = Path(__file__).parents[2]
LIMITS = 20, 103
DIVES: dict[str, dict[str, Any]] = {
    "amphora, 20 px a frame": {"scene": "amphora"},
    "reef, 10 px a frame": {"scene": "reef", "rate_hz": 5.0, "speed_m_s": 0.1},
    "reef, 50 px a frame": {"scene": "reef", "rate_hz": 2.0, "speed_m_s": 0.3},
}


def measure(frame: Frame, result: GraphCutResult, cpu_s: float) -> dict[str, float]:
    mask = frame.seen & (frame.disparity >= LIMITS[0]) & (frame.disparity <= LIMITS[1])
    errors = evaluate(result.disparity, frame.disparity, mask)
    bad = {f"bad_{x}": errors.filled.bad_percent[f"bad-{x}"] for x in ("0.5", "1", "2")}
    return {**bad, "density_percent": errors.density_percent, "cpu_s": cpu_s}


def run(frames: list[Frame], effort: str, sequence: bool) -> dict[str, float]:
    """Means over all frames but the first."""
    before, rows = None, []
    for frame in frames:
        started = time.process_time()
        result = graph_cut(frame.left, frame.right, *LIMITS, effort=effort, before=before if sequence else None)
        rows.append(measure(frame, result, time.process_time() - started))
        before = result.frame
    return {key: float(np.mean([row[key] for row in rows[1:]])) for key in rows[0]}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--efforts", nargs="+", default=["balanced"], choices=["balanced", "quality"])
    parser.add_argument("--frames", type=int, default=5)
    parser.add_argument("--output", type=Path, default=ROOT / "bench_out")
    args = parser.parse_args()
    found: list[dict[str, Any]] = []
    sys.stdout.write(f"| dive | effort | start | bad-0.5 / 1 / 2 | density % | CPU s |\n|{' --- |' * 6}\n")
    for name, choice in DIVES.items():
        frames = rectified_frames(args.frames, width=640, height=480, **choice)
        for effort in args.efforts:
            run(frames[:1] * 2, effort, True)  # compiles
            for sequence in (False, True):
                row = run(frames, effort, sequence)
                start = "the frame before" if sequence else "alone"
                found.append({"dive": name, "effort": effort, "start": start, **row})
                bad = " / ".join(f"{row[f'bad_{x}']:.2f}" for x in ("0.5", "1", "2"))
                cells = (name, effort, start, bad, f"{row['density_percent']:.1f}", f"{row['cpu_s']:.2f}")
                sys.stdout.write(f"| {' | '.join(cells)} |\n")
                sys.stdout.flush()
    args.output.mkdir(parents=True, exist_ok=True)
    (args.output / "matching_sequence.json").write_text(json.dumps(found, indent=1))
    return 0


if __name__ == "__main__":
    sys.exit(main())
