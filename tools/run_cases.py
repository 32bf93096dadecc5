"""Run the command of every case folder and table what comes out.

    python tools/run_cases.py ../shared/cases [--output cases_out] [--only 09-baseline-mm ...]

A case is a folder with inputs and a README with a line ``command:``. Each runs in a copy of its folder, with ``base/``
beside it, within a time and an amount of memory. Leaves ``cases.md`` and ``cases.json``. The judgement is as far as a
program can go: the median depth of every case made from ``base/`` is known, and what a refusal should look like.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import re
import resource
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from uw_recon_ros.progress import say

TRUE_DEPTH_M = 1.256
DEPTH_TOLERANCE = 0.03
JUDGEMENTS = ("works", "refused clearly", "confusing", "silently wrong", "crash", "not run")
_CRASH = re.compile(r"Traceback \(most recent call last\)|internal error", re.IGNORECASE)
_RAW = re.compile(
    r"\[Errno|could not (broadcast|determine a constructor)|while scanning|cv2\.error|OpenCV\(|\w+Error:", re.IGNORECASE
)
_DOUBT = re.compile(r"warning|unreliable|not reliable|not checked", re.IGNORECASE)
_PLACEHOLDER = re.compile(r"\.\.\.|(?<=\s)[LRX](?=\s|\.|$)")
#: What stands where a README abbreviates its command or is missing.
SPELLED_OUT = {
    "08-one-camera": ["pair base/left/frame0000.png base/right/frame0000.png --calibration head_camera.yaml"],
    "20-realsense-rect": ["info bag", "survey bag"],
    "21-rect-topic-raw-info": [
        "survey bag --left-topic /stereo/left/image_rect_color --right-topic /stereo/right/image_rect_color"
    ],
    "37-fisheye-lens": ["pair left/f0000.png right/f0000.png --calibration calibration.yaml"],
    "40-two-videos": ["survey GX010042_left.MP4", "pack --left GX010042_left.MP4 --right GX010017_right.MP4"],
    "42-sbs-stills": ["pack --left imgs/*.jpg --right imgs/*.jpg"],
    "43-exif-orientation": [
        "pair left/GOPR0000.JPG right/GOPR0000.JPG --calibration base/rig.yaml", "survey ."
    ],
    "49-gopro-shifted-equal-count": ["survey . --calibration calibration.yaml"],
    "52-bayer-png": ["pair left.png right.png"],
    "56-row-interleaved": ["pair interleaved.png interleaved.png"],
    "58-mpo": ["pair stereo.mpo stereo.mpo"],
}  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """What one command did.

    Parameters
    ----------
    case, command : str
    code : int or None
        Exit code; negative: ended by that signal; None: not run.
    seconds : float
    peak_mb : float
        Greatest resident memory of a process, MB.
    last_line : str
        Of standard error.
    raw_words : bool
        A traceback, an internal error, or the system's or a library's own sentence was shown.
    depth_m : float or None
        Median metric depth of what was written; None where nothing metric was.
    judgement : str
        One of `JUDGEMENTS`.
    """

    case: str
    command: str
    code: int | None
    seconds: float
    peak_mb: float
    last_line: str
    raw_words: bool
    depth_m: float | None
    judgement: str


def commands(case: Path) -> list[str]:
    """Commands of a case, without the program's name; [] where its README gives none that can be run."""
    if case.name in SPELLED_OUT:
        return SPELLED_OUT[case.name]
    readme = case / "README"
    line = (
        re.search(r"^command:\s*(.+)$", readme.read_text(errors="replace"), re.MULTILINE) if readme.is_file() else None
    )
    if line is None:
        return []
    words = re.sub(r"\(.*?\)", "", line[1])
    parts = [part.strip().removeprefix("uw_recon ") for part in words.split(";")]
    both = re.match(r"info / survey (.+)", parts[0])
    parts = [f"info {both[1]}", f"survey {both[1]}"] if both else parts
    return [] if any(_PLACEHOLDER.search(part) for part in parts) else parts


def prepare(case: Path, work: Path) -> None:
    """Copy a case to a work folder, and the base pair into it where a command needs it."""
    shutil.copytree(case, work)
    for path in [work, *work.rglob("*")]:
        path.chmod(path.stat().st_mode | 0o200)
    base = case.parent / "base"
    if base.is_dir() and any("base/" in command for command in commands(case)):
        (work / "base").symlink_to(base.resolve())


def arguments_of(command: str, work: Path, output: str) -> list[str]:
    """Words of a command, its patterns expanded as a shell does, with an output of its own."""
    words = shlex.split(command)
    given = [w for word in words for w in (_expanded(word, work) if "*" in word else [word])]
    if words[0] in ("pair", "survey", "pack") and "-o" not in words:
        given += ["-o", output]
    return [output if word == "out" else word for word in given]


def _expanded(pattern: str, work: Path) -> list[str]:
    return sorted(str(path.relative_to(work)) for path in work.glob(pattern)) or [pattern]


def run(program: Sequence[str], work: Path, seconds: float, memory_mb: int) -> tuple[int, float, float, str]:
    """Run within bounds: exit code, seconds, peak memory in MB, standard error."""

    def bound() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (memory_mb << 20, memory_mb << 20))

    started = time.monotonic()
    with tempfile.TemporaryFile("w+", errors="replace") as said:
        process = subprocess.Popen(
            program, cwd=work, stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=said,
            start_new_session=True, preexec_fn=bound,
        )  # fmt: skip
        timer = threading.Timer(seconds, os.killpg, (process.pid, signal.SIGKILL))
        timer.start()
        _, status, usage = os.wait4(process.pid, 0)
        timer.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
        said.seek(0)
        return process.returncode, time.monotonic() - started, usage.ru_maxrss / 1024, said.read()


def median_depth(output: Path) -> float | None:
    """Median of all depth maps in an output folder, m; None without any."""
    maps = [cv2.imread(str(path), cv2.IMREAD_UNCHANGED) for path in sorted(output.rglob("*.tiff"))]
    finite = [m[np.isfinite(m)] for m in maps if m is not None and m.dtype == np.float32]
    values = np.concatenate(finite) if finite else np.empty(0)
    return float(np.median(values)) if values.size else None


def says_doubt(output: Path, stderr: str) -> bool:
    """Whether the terminal, a report or a frame's row says that the result is not to be trusted."""
    reports = [json.loads(path.read_text()) for path in output.glob("report.json")]
    rows = [row for path in output.glob("frames.csv") for row in csv.DictReader(path.open())]
    doubted = any(_unreliable(report) for report in reports) or any(row.get("status") == "unreliable" for row in rows)
    return doubted or bool(_DOUBT.search(stderr))


def _unreliable(report: dict[str, Any]) -> bool:
    return report.get("reliable") is False or bool(report.get("rectification", {}).get("warnings"))


def judge(code: int, stderr: str, depth_m: float | None, doubted: bool) -> str:
    """Judge an outcome, as far as a program can."""
    if _CRASH.search(stderr) or code < 0 or code > 2:
        return "crash"
    if code != 0:
        return "confusing" if _RAW.search(stderr) or _lines_of_error(stderr) > 1 else "refused clearly"
    wrong = depth_m is not None and abs(depth_m / TRUE_DEPTH_M - 1) > DEPTH_TOLERANCE
    return "silently wrong" if wrong and not doubted else "works"


def _lines_of_error(stderr: str) -> int:
    """Lines from the last one that starts with the program's name to the end."""
    lines = [line for line in stderr.splitlines() if line.strip()]
    starts = [number for number, line in enumerate(lines) if line.startswith("uw_recon")]
    return len(lines) - starts[-1] if starts else 1


def run_case(case: Path, program: Sequence[str], seconds: float, memory_mb: int) -> list[Outcome]:
    """Run all commands of a case, one after the other, in one copy of it."""
    todo = commands(case)
    if not todo:
        return [Outcome(case.name, "", None, 0.0, 0.0, "no command that can be run", False, None, "not run")]
    with tempfile.TemporaryDirectory(prefix="case_") as folder:
        work = Path(folder) / case.name
        prepare(case, work)
        results = []
        for number, command in enumerate(todo):
            output = f"out{number}"
            words = arguments_of(command, work, f"../{output}")
            code, took, peak, said = run([*program, *words], work, seconds, memory_mb)
            results.append(_outcome(case.name, command, (code, took, peak, said), Path(folder) / output))
        return results


def _outcome(case: str, command: str, ran: tuple[int, float, float, str], output: Path) -> Outcome:
    code, took, peak, said = ran
    depth = median_depth(output)
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    raw = bool(_CRASH.search(said) or _RAW.search(said))
    judgement = judge(code, said, depth, says_doubt(output, said))
    return Outcome(case, command, code, took, peak, lines[-1] if lines else "", raw, depth, judgement)


def as_markdown(outcomes: Sequence[Outcome]) -> str:
    """Table of outcomes."""
    rows = ["| case | command | exit | s | MB | depth, m | raw words | judgement | last line |", "| --- " * 9 + "|"]
    for o in outcomes:
        depth = "" if o.depth_m is None else f"{o.depth_m:.3f}"
        cells = [o.case, o.command.split(" ")[0], "" if o.code is None else str(o.code), f"{o.seconds:.1f}",
                 f"{o.peak_mb:.0f}", depth, "yes" if o.raw_words else "", o.judgement, o.last_line]  # fmt: skip
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(rows) + "\n"


def main() -> int:
    """Run cases; 1 where one crashed, confused or was silently wrong."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=Path)
    parser.add_argument("--output", type=Path, default=Path("cases_out"), help="default: %(default)s")
    parser.add_argument("--only", nargs="*", default=[], help="names of cases")
    parser.add_argument("--seconds", type=float, default=300.0, help="for a command; default: %(default)s")
    parser.add_argument("--memory-mb", type=int, default=4096, help="of address space; default: %(default)s")
    parser.add_argument("--program", nargs="+", default=[str(Path(sys.executable).parent / "uw_recon")])
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    folders = sorted(p for p in args.cases.iterdir() if p.is_dir() and p.name != "base")
    outcomes: list[Outcome] = []
    for case in folders:
        if args.only and case.name not in args.only:
            continue
        outcomes += run_case(case, args.program, args.seconds, args.memory_mb)
        say(f"{outcomes[-1].case}: {outcomes[-1].judgement}: {outcomes[-1].last_line}")
        (args.output / "cases.json").write_text(json.dumps([asdict(o) for o in outcomes], indent=1) + "\n")
        (args.output / "cases.md").write_text(as_markdown(outcomes))
    sys.stdout.write(as_markdown(outcomes))
    return int(any(o.judgement in ("confusing", "silently wrong", "crash") for o in outcomes))


if __name__ == "__main__":
    sys.exit(main())
