"""Throughput and memory of `uw_recon survey` against the number of processes.

Usage: python test/benchmark/survey_throughput.py [--frames 24] [--jobs 1 2] [--repeat 2] [--memory 0]

Throughput is measured in one run a setting, from the first finished frame to the last, so that start-up (interpreters,
compiled code from the cache) is left out; its share of N times one process's is the efficiency. CPU seconds a frame
tell how much of what is missing is other programs' work on the same machine. `--memory N` surveys N tiny frames instead
and prints the most memory that a worker and the main process had needed after a tenth of them and in the end.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import psutil

from uw_recon_ros.bags import RawMessage, messages, open_bag, write_bag
from uw_recon_ros.simulate.params import SimulateParams
from uw_recon_ros.simulate.write import simulate

SOME = 6  # simulated frames, which then come again and again
PERIOD_NS = 500_000_000


def looped(path: Path, frames: int) -> Iterator[RawMessage]:
    """The messages of a short dive, repeated with stamps that go on."""
    with open_bag(path) as bag:
        once = [m for m in bag.raw_messages() if not m.topic.startswith("/truth")]
    first = once[0].stamp_ns
    for number in range(frames):
        for message in once:
            index = round((message.stamp_ns - first) / PERIOD_NS)
            if index == number % SOME:
                yield restamped(message, first + number * PERIOD_NS)


def restamped(message: RawMessage, stamp_ns: int) -> RawMessage:
    decoded = messages.decode(message)
    decoded.header.stamp.sec, decoded.header.stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
    return replace(message, stamp_ns=stamp_ns, data=messages.encode(decoded)[1])


def make_dive(folder: Path, frames: int, width: int, height: int) -> Path:
    simulate(folder / "short", SimulateParams(frames=SOME, width=width, height=height, snow_per_m3=10.0))
    write_bag(folder / "dive", looped(folder / "short", frames))
    return folder / "dive"


@dataclass
class Run:
    """What a survey took."""

    rate: float
    cpu_s: float
    main_mb: list[tuple[int, float]]
    rows: list[dict[str, str]]


def survey(dive: Path, output: Path, jobs: int, extra: list[str]) -> Run:
    command = [sys.executable, "-m", "uw_recon_ros.cli", "survey", str(dive), "-o", str(output), "--quiet"]
    before = os.times()
    process = subprocess.Popen([*command, "--jobs", str(jobs), *extra])
    watch = Watch(process.pid, output / "state" / "journal.jsonl")
    code = process.wait()
    watch.join()
    if code:
        raise SystemExit(f"survey: exit {code}")
    after = os.times()
    with (output / "timing.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    cpu = after.children_user + after.children_system - before.children_user - before.children_system
    return Run(watch.rate, max(cpu, watch.cpu_s), watch.main_mb, rows)


class Watch(threading.Thread):
    """Looks at a survey from outside: when its rows appear, how much memory its main process has, CPU of all."""

    def __init__(self, pid: int, journal: Path) -> None:
        super().__init__(daemon=True)
        self._process, self._journal = psutil.Process(pid), journal
        self.main_mb: list[tuple[int, float]] = []  # frames done, MB
        self.rate = self.cpu_s = 0.0
        self._cpu: dict[int, float] = {}
        self.start()

    def run(self) -> None:
        first: tuple[float, int] | None = None
        while self._process.is_running():
            rows = self._journal.read_bytes().count(b"\n") if self._journal.is_file() else 0
            try:
                self._look(rows)
            except psutil.Error:
                return
            now = time.monotonic()
            if rows and first is None:
                first = now, rows
            if first and rows > first[1] and rows > getattr(self, "_seen", 0):
                self._seen = rows
                self.rate = (rows - first[1]) / (now - first[0])
            time.sleep(0.05 + 2e-5 * rows)

    def _look(self, rows: int) -> None:
        self.main_mb.append((rows, self._process.memory_info().rss / 2**20))
        for process in [self._process, *self._process.children(recursive=True)]:
            try:
                times = process.cpu_times()
            except psutil.Error:
                continue
            self._cpu[process.pid] = times.user + times.system
        self.cpu_s = sum(self._cpu.values())


def throughput(options: argparse.Namespace, folder: Path) -> list[dict[str, float]]:
    dive = make_dive(folder, options.frames, options.width, options.height)
    survey(dive, folder / "warm", 1, ["--max-frames", "1", *options.survey])
    results = []
    for repeat in range(options.repeat):
        for jobs in options.jobs:
            run = survey(dive, folder / f"out-{jobs}-{repeat}", jobs, options.survey)
            results.append({"jobs": jobs, "frames_per_s": run.rate, "cpu_s_per_frame": run.cpu_s / options.frames})
            print_line(results[-1])
    best = {jobs: max(r["frames_per_s"] for r in results if r["jobs"] == jobs) for jobs in options.jobs}
    least = {jobs: min(r["cpu_s_per_frame"] for r in results if r["jobs"] == jobs) for jobs in options.jobs}
    first = options.jobs[0]
    for jobs, rate in best.items():
        share = rate / (jobs / first * best[first])
        values = {"jobs": jobs, "best_frames_per_s": rate, "efficiency": share}
        print_line(values | {"cpu_efficiency": least[first] / least[jobs]})
    return results


def memory(options: argparse.Namespace, folder: Path) -> None:
    dive = make_dive(folder, options.memory, 48, 36)
    params = folder / "small.yaml"
    params.write_text("/**: {ros__parameters: {min_disparity: 0, max_disparity: 8, kz2_sweeps: 1}}\n")
    run = survey(dive, folder / "out", options.jobs[-1], ["--params", str(params), *options.survey])
    peaks = [float(row["peak_mb"]) for row in run.rows]
    tenth = len(peaks) // 10
    print_line(
        {
            "frames": len(peaks),
            "worker_mb_after_a_tenth": max(peaks[: tenth + 1]),
            "worker_mb_in_the_end": max(peaks),
            "main_mb_after_a_tenth": max(mb for rows, mb in run.main_mb if rows <= len(peaks) / 10),
            "main_mb_after_all": max(mb for rows, mb in run.main_mb if rows < len(peaks)),
            "main_mb_with_bag_and_report": max(mb for _, mb in run.main_mb),
            "frames_per_s": run.rate,
        }
    )


def print_line(values: dict[str, float]) -> None:
    sys.stdout.write(json.dumps({name: round(value, 4) for name, value in values.items()}) + "\n")
    sys.stdout.flush()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=24)
    parser.add_argument("--width", type=int, default=320)
    parser.add_argument("--height", type=int, default=240)
    parser.add_argument("--jobs", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--repeat", type=int, default=2)
    parser.add_argument("--memory", type=int, default=0, metavar="N", help="survey N tiny frames, print the memory")
    parser.add_argument("survey", nargs="*", default=[], help="options for uw_recon survey, after --")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        if options.memory:
            memory(options, Path(folder))
        else:
            throughput(options, Path(folder))


if __name__ == "__main__":
    main()
