"""Every benchmark of the project, one after the other: the numbers the documents quote.

    python test/benchmark/run_all.py [--output bench_out] [NAME ...]

Leaves ``NAME.txt`` with what each printed, beside the JSON and Markdown files that some write themselves. Those that
measure on the Middlebury pairs need ``../shared/data`` beside the project.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
LIBRARIES = {"run_all", "drowned_pairs", "simulated_frames", "peers", "wls_peer", "match_tables", "match_plot"}
HOURS = {"graph_soak"}  # run where named only
WRITES_FILES = {"matching", "matching_profile", "matching_sequence", "match_growth", "match_startup", "kz2_reference"}


def main() -> int:
    """Run them; return how many failed."""
    names = sorted(path.stem for path in HERE.glob("*.py") if path.stem not in LIBRARIES)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("bench_out"))
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(names))
    args = parser.parse_args()
    if unknown := set(args.names) - set(names):
        parser.error(f"expected {', '.join(names)}, got {', '.join(sorted(unknown))}")
    args.output.mkdir(parents=True, exist_ok=True)
    return sum(_run(name, args.output) for name in args.names or [n for n in names if n not in HOURS])


def _run(name: str, output: Path) -> bool:
    """Whether one benchmark failed; its output goes to the terminal and to a file."""
    sys.stdout.write(f"\n== {name}\n")
    command = [sys.executable, str(HERE / f"{name}.py")]
    if name in WRITES_FILES:
        command += ["--output", str(output)]
    with (output / f"{name}.txt").open("w", encoding="utf-8") as log:
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
        for line in process.stdout or ():
            sys.stdout.write(line)
            sys.stdout.flush()
            log.write(line)
    return process.wait() != 0


if __name__ == "__main__":
    sys.exit(main())
