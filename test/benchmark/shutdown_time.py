"""How the executables end on a signal at a random moment.

    python test/benchmark/shutdown_time.py [--runs 20] [--latest 3] [NAME ...]

Each process is signalled (SIGINT or SIGTERM by lot) between its handler's installation and so many seconds later: while
modules are loaded, ROS starts, kernels are fetched, or the node idles. Prints exit codes and seconds from signal to
end, and what a process said that did not end well.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

NAMES = ("preprocess_node", "rectify_node", "disparity_node", "point_cloud_node", "pipeline_node", "bag_player_node")
BAG = Path(__file__).parents[2] / "bags" / "amphora"
CODE = "from uw_recon_ros import executables; executables.{}()"


def catches(pid: int, number: int) -> bool:
    """Whether a process has a handler of its own for a signal."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    caught = next(int(line.split()[1], 16) for line in lines if line.startswith("SigCgt"))
    return bool(caught >> (number - 1) & 1)


def end_one(name: str, latest_s: float, lot: random.Random) -> tuple[int, float, str]:
    """Start, signal, wait; return exit code, seconds and what was said."""
    arguments = [str(BAG), "--loop"] if name == "bag_player_node" else []
    environment = {**os.environ, "PYTHONFAULTHANDLER": "1", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"}
    with tempfile.TemporaryFile("w+") as said:
        process = subprocess.Popen(
            [sys.executable, "-c", CODE.format(name), *arguments], stdout=said, stderr=said, env=environment
        )
        while not catches(process.pid, signal.SIGTERM):
            time.sleep(0.001)
        time.sleep(lot.uniform(0, latest_s))
        process.send_signal(lot.choice((signal.SIGINT, signal.SIGTERM)))
        began = time.monotonic()
        code = process.wait(60)
        took = time.monotonic() - began
        said.seek(0)
        return code, took, said.read()


def main() -> None:
    """Print a line for each executable."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", default=NAMES)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--latest", type=float, default=3.0, help="seconds")
    parser.add_argument("--seed", type=int, default=0)
    settings = parser.parse_args()
    lot = random.Random(settings.seed)
    for name in settings.names:
        ends = [end_one(name, settings.latest, lot) for _ in range(settings.runs)]
        codes = dict(Counter(code for code, _, _ in ends))
        took = sorted(seconds for _, seconds, _ in ends)
        spread = f"after {statistics.median(took):.2f} s median, {took[-1]:.2f} s at most"
        sys.stdout.write(f"{name}: exit codes {codes}, {spread}\n")
        for code, _, said in ends:
            if code or "Traceback" in said or "FATAL" in said:
                sys.stdout.write(f"--- {code}\n{said}\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
