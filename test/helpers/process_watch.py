"""What running processes take: processor time, memory, threads, files, segments of shared memory."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

import psutil

_SHARED_MEMORY = Path("/dev/shm")


@dataclass(frozen=True)
class Usage:
    """One process at one moment.

    Parameters
    ----------
    cpu_s : float
        Processor time since its start, all threads.
    rss_mb, private_mb : float
        Resident memory, and that part of it that no other process shares (neither libraries nor segments).
    threads, files : int
        Open now.
    executor_s : float
        Of `cpu_s`, the main thread: messages received, timers, services.
    faults : int
        Pages that the kernel had to give, since its start.
    """

    cpu_s: float
    rss_mb: float
    private_mb: float
    threads: int
    files: int
    executor_s: float
    faults: int


def usage(pid: int) -> Usage:
    """Look at a process."""
    process = psutil.Process(pid)
    with process.oneshot():
        times, memory = process.cpu_times(), process.memory_info()
        return Usage(
            times.user + times.system,
            memory.rss / 1e6,
            (memory.rss - memory.shared) / 1e6,
            process.num_threads(),
            process.num_fds(),
            int(Path(f"/proc/{pid}/task/{pid}/schedstat").read_text().split()[0]) * 1e-9,
            int(Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[7]),
        )


def mapped_segments(pid: int) -> set[str]:
    """Names of the segments of shared memory that a process has mapped."""
    maps = Path(f"/proc/{pid}/maps").read_text().splitlines()
    return {line.split("/dev/shm/")[1].removesuffix(" (deleted)") for line in maps if "/dev/shm/" in line}


def segments() -> set[str]:
    """Names of all segments of Fast DDS on this machine."""
    return {name for name in os.listdir(_SHARED_MEMORY) if name.startswith(("fastrtps_", "fastdds_", "sem.fast"))}


def unmeasured() -> dict[str, str]:
    """The environment without coverage's marks: a process whose files are limited cannot write its data either."""
    return {name: value for name, value in os.environ.items() if not name.startswith("COVERAGE_")}
