"""What a fresh process spends before its first disparity: everything compiled, and everything found compiled.

    python test/benchmark/match_startup.py [--output bench_out]

Each situation is a process of its own, imports included, OpenCV's and numba's too; the empty cache is a temporary
directory. Prints a Markdown table, leaves ``match_startup.json``.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

import match_tables

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
IMPORTS = "import cv2, numpy, numba, scipy.linalg"  # numba fetches the last when it first loads code
OURS = """
from uw_recon_ros.match.stage import Match, MatchParams
Match(MatchParams(method={method!r})).warm_up()
"""
#: A fresh process that matches a pair, less the matching itself: the second, all loaded, tells how long that takes.
TEDDY = """
import time
from drowned_pairs import pairs
from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.types import MatchingPair
teddy = next(truth for truth in pairs() if truth.name == "teddy")
match = Match(MatchParams(effort={effort!r}, max_disparity=59, match_threads=1))
match.images(MatchingPair(teddy.left, teddy.right))
started = time.process_time(), time.perf_counter()
match.images(MatchingPair(teddy.left, teddy.right))
matching = 2 * (time.process_time() - started[0]), 2 * (time.perf_counter() - started[1])
"""
END = """
import json, sys, time
try:
    from uw_recon_ros.jit import cache_use
    use = cache_use() if "uw_recon_ros.match.stage" in sys.modules else (0, 0)
except ImportError:
    use = (0, 0)
cpu, wall = globals().get("matching", (0, 0))
print(json.dumps([time.process_time() - cpu, *use]))
"""


def measure(what: str, code: str, cache: str | None = None) -> dict[str, Any]:
    """One process."""
    environment = os.environ | ({"NUMBA_CACHE_DIR": cache} if cache else {})
    start = "import time; began = time.perf_counter()\n"
    end = END.replace("time.process_time() - cpu", "time.process_time() - cpu, time.perf_counter() - began - wall")
    done = subprocess.run(
        [sys.executable, "-c", start + code + end], env=environment, check=True, text=True, stdout=subprocess.PIPE
    )
    cpu, wall, compiled, loaded = json.loads(done.stdout)
    return {"what": what, "cpu_s": cpu, "wall_s": wall, "misses": compiled, "hits": loaded}


def main() -> int:
    """Measure all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=ROOT / "bench_out")
    args = parser.parse_args()
    rows = [measure("that imports OpenCV, numba and scipy alone", IMPORTS)]
    for method in ("graph_cut", "kz2"):
        code = OURS.format(method=method)
        with tempfile.TemporaryDirectory() as empty:
            rows.append(measure(f"`{method}`, nothing compiled yet", code, empty))
        measure("", code)  # whatever is in the user's cache, it is complete now
        rows.append(measure(f"`{method}`, everything compiled", code))
    for effort in ("navigation", "balanced"):
        code = f"import sys; sys.path.insert(0, {str(HERE)!r})\n" + TEDDY.format(effort=effort)
        measure("", code)
        rows.append(measure(f"teddy, `{effort}`, less the matching", code))
    args.output.mkdir(parents=True, exist_ok=True)
    (args.output / "match_startup.json").write_text(json.dumps(rows, indent=1))
    sys.stdout.write(match_tables.startup(rows) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
