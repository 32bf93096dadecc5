"""Write what the benchmarks measured into the documents: nothing is pasted by hand.

    python test/benchmark/matching.py && python test/benchmark/match_growth.py && python test/benchmark/match_startup.py
    python tools/write_benchmarks.py [--input bench_out] [--check]

A line ``<!-- bench: NAME -->`` is followed by a table, up to ``<!-- end -->``. The tables are made from the JSON files
of the input folder; where one is absent, what it would fill is left as it is, and said. The plot of accuracy over time
is copied into docs/images. ``--check`` writes nothing and fails where something would change.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "test" / "benchmark"))

import match_tables  # noqa: E402

PLOT = "accuracy_over_time.svg"
#: Name of a table, the file it is made from, and how.
TABLES: dict[str, tuple[str, Callable[[Any], str]]] = {
    "matching in air": ("matching.json", match_tables.in_air),
    "matching under water": ("matching.json", match_tables.under_water),
    "matching growth": ("match_growth.json", lambda data: match_tables.growth(data["growth"])),
    "matching hard inputs": ("match_growth.json", lambda data: match_tables.hard_inputs(data["hard"])),
    "matching profile": ("matching_profile.json", match_tables.profile),
    "matching start-up": ("match_startup.json", match_tables.startup),
}
MARKED = re.compile(r"(<!-- bench: (?P<name>[^\n]+?) -->\n).*?(<!-- end -->)", re.DOTALL)


def filled(text: str, folder: Path) -> str:
    """The text with its tables anew.

    Raises
    ------
    ValueError
        A table of that name is not known.
    """

    def table(match: re.Match[str]) -> str:
        name = match["name"]
        if name not in TABLES:
            raise ValueError(f"<!-- bench: {name} -->: expected one of {', '.join(TABLES)}")
        source, make = TABLES[name]
        if not (folder / source).is_file():
            sys.stderr.write(f"{name}: left as it is, no {folder / source}\n")
            return match[0]
        return f"{match[1]}{make(json.loads((folder / source).read_text()))}\n{match[3]}"

    return MARKED.sub(table, text)


def main() -> int:
    """Write, or compare."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--input", type=Path, default=ROOT / "bench_out")
    parser.add_argument("--check", action="store_true")
    args = parser.parse_args()
    documents = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]
    new = {path: filled(path.read_text(encoding="utf-8"), args.input) for path in documents}
    if (args.input / PLOT).is_file():
        new[ROOT / "docs" / "images" / PLOT] = (args.input / PLOT).read_text(encoding="utf-8")
    changed = [path for path, text in new.items() if not path.is_file() or path.read_text(encoding="utf-8") != text]
    for path in changed:
        sys.stdout.write(f"{path.relative_to(ROOT)}\n")
        if not args.check:
            path.write_text(new[path], encoding="utf-8")
    return int(args.check and bool(changed))


if __name__ == "__main__":
    sys.exit(main())
