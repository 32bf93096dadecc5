"""Run the command of every case folder and table what comes out.

    python tools/run_cases.py ../shared/cases [--output cases_out] [--only 09-baseline-mm ...]

A case is a folder with inputs and a README with a line ``command:``. Each runs in a copy of its folder, with ``base/``
beside it, within a time and an amount of memory. Leaves ``cases.md`` and ``cases.json``. Exit codes, the codes in
``report.json`` and ``frames.csv``, and depth judge: the median depth of every case made from ``base/`` is known. Only
whether a refusal is clear is judged by its words.
"""

from __future__ import annotations

import argparse
import contextlib
import csv
import json
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import psutil

from uw_recon_ros.findings import Code
from uw_recon_ros.progress import say

TRUE_DEPTH_M = 1.256
DEPTH_TOLERANCE = 0.03
JUDGEMENTS = (
    "works", "works, no metres", "readable", "doubted", "refused clearly", "confusing", "silently wrong", "crash",
    "out of time", "not run",
)  # fmt: skip
BAD = ("confusing", "silently wrong", "crash", "out of time")
#: What a foreign sentence looks like: the system's, a library's, or an exception's name.
_RAW = re.compile(
    r"\[Errno|could not (broadcast|determine a constructor)|while scanning|cv2\.error|OpenCV\(|\w+Error:", re.IGNORECASE
)
_TRACE = "Traceback (most recent call last)"
_PLACEHOLDER = re.compile(r"\.\.\.|(?<=\s)[LRX](?=\s|\.|$)")
_POLL_S = 0.1
_BASE_PAIR = "pair base/left/frame0000.png base/right/frame0000.png"
#: What stands where a README abbreviates its command or is missing.
SPELLED_OUT = {
    "04-opencv-yml": [f"{_BASE_PAIR} --calibration {name}" for name in ("stereo.yml", "stereo.xml")],
    "06-camera-model-fisheye": [
        f"{_BASE_PAIR} --calibration {name}" for name in ("rig.yaml", "equidistant.yaml", "melodic.yaml")
    ],
    "08-one-camera": [f"{_BASE_PAIR} --calibration head_camera.yaml"],
    "16-zed-conf": [f"{_BASE_PAIR} --calibration {name}" for name in ("SN12345.conf", "agisoft.xml", "matlab.json")],
    "20-realsense-rect": ["info bag", "survey bag"],
    "21-rect-topic-raw-info": [
        "survey bag --left-topic /stereo/left/image_rect_color --right-topic /stereo/right/image_rect_color"
    ],
    "37-fisheye-lens": ["pair left/f0000.png right/f0000.png --calibration calibration.yaml"],
    "38-black-border": [
        f"pair {name}/left.png {name}/right.png" for name in ("b2", "b16", "circle", "letterbox", "osdbar")
    ],
    "40-two-videos": ["survey GX010042_left.MP4", "pack --left GX010042_left.MP4 --right GX010017_right.MP4"],
    "41-sbs-video": ["survey dive_sbs.mp4", "survey dive_sbs.avi"],
    "42-sbs-stills": ["pack --left 'imgs/*.jpg' --right 'imgs/*.jpg'"],
    "43-exif-orientation": [
        "pair left/GOPR0000.JPG right/GOPR0000.JPG --calibration base/rig.yaml", "survey ."
    ],
    "49-gopro-shifted-equal-count": ["survey . --calibration calibration.yaml", "survey ."],
    "52-bayer-png": ["pair left.png right.png"],
    "56-row-interleaved": ["pair interleaved.png interleaved.png"],
    "58-mpo": ["pair stereo.mpo stereo.mpo"],
    "60-ros1-bag": ["survey dive.bag", "info dive.bag"],
    "68-compressed-h264-in-CompressedImage": ["info bag", "survey bag"],
}  # fmt: skip


@dataclass(frozen=True)
class Outcome:
    """What one command did.

    Parameters
    ----------
    case, command : str
    code : int or None
        Exit code; negative: ended by that signal; None: not run, or out of time.
    seconds : float
    peak_mb : float
        Greatest resident memory of all its processes together, MB.
    codes : tuple of str
        What the result or the failure says of itself.
    last_line : str
        Of standard error.
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
    codes: tuple[str, ...]
    last_line: str
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


def arguments_of(command: str, output: str) -> list[str]:
    """Words of a command with an output of its own; patterns stay, as in quotes."""
    words = shlex.split(command)
    if words[0] in ("pair", "survey", "pack") and "-o" not in words:
        words += ["-o", output]
    return [output if word == "out" else word for word in words]


def run(program: Sequence[str], work: Path, seconds: float, memory_mb: int) -> tuple[int | None, float, float, str]:
    """Run within bounds: exit code, seconds, peak memory in MB, what it said. No process is left behind.

    The exit code is None where the time ran out, of which the machine may be the cause.
    """
    started, peak, late = time.monotonic(), 0.0, False
    with tempfile.TemporaryFile("w+", errors="replace") as said:
        process = psutil.Popen(program, cwd=work, stdin=subprocess.DEVNULL, stdout=said, stderr=said)
        try:
            while not _ended(process):
                peak = max(peak, resident_mb(process))
                late = time.monotonic() - started > seconds
                if peak > memory_mb or late:
                    break
        finally:
            end(process)
        said.seek(0)
        return None if late else process.returncode, time.monotonic() - started, peak, said.read()


def _ended(process: psutil.Popen) -> bool:
    try:
        process.wait(_POLL_S)
    except (psutil.TimeoutExpired, subprocess.TimeoutExpired):
        return False
    return True


def _family(process: psutil.Popen) -> list[psutil.Process]:
    try:
        return [process, *process.children(recursive=True)]
    except psutil.NoSuchProcess:
        return []


def resident_mb(process: psutil.Popen) -> float:
    """Resident memory of a process and all below it, MB."""
    total = 0
    for one in _family(process):
        with contextlib.suppress(psutil.Error):
            total += one.memory_info().rss
    return total / 2**20


def end(process: psutil.Popen) -> None:
    """Kill a process and all below it, if they still run."""
    for one in _family(process):
        with contextlib.suppress(psutil.Error):
            one.kill()
    process.wait()


def median_depth(output: Path) -> float | None:
    """Median of all depth maps in an output folder, m; None without any."""
    maps = [cv2.imread(str(path), cv2.IMREAD_UNCHANGED) for path in sorted(output.rglob("*.tiff"))]
    finite = [m[np.isfinite(m)] for m in maps if m is not None and m.dtype == np.float32]
    values = np.concatenate(finite) if finite else np.empty(0)
    return float(np.median(values)) if values.size else None


@dataclass(frozen=True)
class Told:
    """What an output folder says of itself: ``report.json`` and ``frames.csv``.

    Parameters
    ----------
    codes : tuple of str
        Of warnings and failures, each once.
    reliable : bool
    reconstructed : int
        Pairs that came through.
    reasons : tuple of str
        Of the pairs that did not.
    """

    codes: tuple[str, ...] = ()
    reliable: bool = True
    reconstructed: int = 0
    reasons: tuple[str, ...] = ()


def read_told(output: Path) -> Told:
    """What an output folder says; nothing where there is no report."""
    if not (output / "report.json").is_file():
        return Told()
    report = json.loads((output / "report.json").read_text())
    codes = [warning["code"] for warning in report.get("warnings", [])]
    if "frames" in report:
        return _told_of_survey(output, report, codes)
    failed = report.get("failed")
    if failed:
        return Told((*codes, failed["code"]), False, 0, (failed["text"],))
    return Told(tuple(codes), report.get("reliable", True), 1)


def _told_of_survey(output: Path, report: dict[str, Any], codes: list[str]) -> Told:
    with (output / "frames.csv").open(newline="") as table:
        rows = list(csv.DictReader(table))
    failed = [row for row in rows if row["status"] == "failed"]
    codes += [code for row in rows for code in row["warnings"].split()]
    reasons = tuple(dict.fromkeys(row["reason"] for row in failed))
    return Told(tuple(dict.fromkeys(codes)), report["reliable"], len(rows) - len(failed), reasons)


def judge(code: int | None, stderr: str, told: Told, depth_m: float | None) -> str:
    """Judge an outcome, as far as a program can; without an exit code the time ran out."""
    if code is None:
        return "out of time"
    if code not in (0, 1, 2) or _TRACE in stderr or Code.INTERNAL in told.codes:
        return "crash"
    if told.reconstructed:
        return _judge_result(told, depth_m)
    if code == 0:
        return "readable"
    lines = told.reasons or (last_error(stderr),)
    return "confusing" if any(_RAW.search(line) or "\n" in line for line in lines) else "refused clearly"


def _judge_result(told: Told, depth_m: float | None) -> str:
    if depth_m is None:
        return "works, no metres"
    if abs(depth_m / TRUE_DEPTH_M - 1) <= DEPTH_TOLERANCE:
        return "works"
    return "silently wrong" if told.reliable and not told.codes else "doubted"


def last_error(stderr: str) -> str:
    """From the last line that starts with the program's name to the end."""
    lines = [line for line in stderr.splitlines() if line.strip()]
    starts = [number for number, line in enumerate(lines) if line.startswith("uw_recon")]
    return "\n".join(lines[starts[-1] if starts else -1 :])


def run_case(case: Path, program: Sequence[str], seconds: float, memory_mb: int) -> list[Outcome]:
    """Run all commands of a case, one after the other, in one copy of it."""
    todo = commands(case)
    if not todo:
        return [Outcome(case.name, "", None, 0.0, 0.0, (), "no command that can be run", None, "not run")]
    with tempfile.TemporaryDirectory(prefix="case_") as folder:
        work = Path(folder) / case.name
        prepare(case, work)
        results = []
        for number, command in enumerate(todo):
            output = f"out{number}"
            words = arguments_of(command, f"../{output}")
            code, took, peak, said = run([*program, *words], work, seconds, memory_mb)
            results.append(_outcome(case.name, command, (code, took, peak, said), Path(folder) / output))
        return results


def _outcome(case: str, command: str, ran: tuple[int | None, float, float, str], output: Path) -> Outcome:
    code, took, peak, said = ran
    depth, told = median_depth(output), read_told(output)
    lines = [*told.reasons, *(line.strip() for line in said.splitlines() if line.strip())]
    shown = told.reasons[0] if told.reasons and not told.reconstructed else lines[-1] if lines else ""
    return Outcome(case, command, code, took, peak, told.codes, shown, depth, judge(code, said, told, depth))


def as_markdown(outcomes: Sequence[Outcome]) -> str:
    """Table of outcomes."""
    rows = ["| case | command | exit | s | MB | depth, m | codes | judgement | last line |", "| --- " * 9 + "|"]
    for o in outcomes:
        depth = "" if o.depth_m is None else f"{o.depth_m:.3f}"
        cells = [o.case, _shortened(o.command), "" if o.code is None else str(o.code), f"{o.seconds:.1f}",
                 f"{o.peak_mb:.0f}", depth, " ".join(o.codes), o.judgement, o.last_line]  # fmt: skip
        rows.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join(rows) + "\n"


def _shortened(command: str) -> str:
    return command.removeprefix(_BASE_PAIR + " -o out ").replace(_BASE_PAIR, "pair base")


def main() -> int:
    """Run cases; 1 where one crashed, confused, was silently wrong or did not end in time."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=Path)
    parser.add_argument("--output", type=Path, default=Path("cases_out"), help="default: %(default)s")
    parser.add_argument("--only", nargs="*", default=[], help="names of cases")
    parser.add_argument("--seconds", type=float, default=300.0, help="for a command; default: %(default)s")
    parser.add_argument(
        "--memory-mb", type=int, default=4096, help="resident, of all its processes; default: %(default)s"
    )
    parser.add_argument("--program", nargs="+", default=[str(Path(sys.executable).parent / "uw_recon")])
    args = parser.parse_args()
    args.output.mkdir(parents=True, exist_ok=True)
    folders = sorted(p for p in args.cases.iterdir() if p.is_dir() and p.name != "base")
    outcomes: list[Outcome] = []
    for case in folders:
        if args.only and case.name not in args.only:
            continue
        outcomes += run_case(case, args.program, args.seconds, args.memory_mb)
        for o in (o for o in outcomes if o.case == case.name):
            say(f"{o.case}: {o.judgement}: {o.last_line}")
        (args.output / "cases.json").write_text(json.dumps([asdict(o) for o in outcomes], indent=1) + "\n")
        (args.output / "cases.md").write_text(as_markdown(outcomes))
    sys.stdout.write(as_markdown(outcomes))
    return int(any(o.judgement in BAD for o in outcomes))


if __name__ == "__main__":
    sys.exit(main())
