"""The same survey on a real Dask cluster on this machine, a worker killed midway."""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from distributed import Client
from helpers.dives import PARAMS, digests, make_dive

from uw_recon_ros.cli import main

FRAMES = 10


@dataclass
class Cluster:
    """A scheduler and two workers, each a process."""

    address: str
    scheduler: subprocess.Popen[bytes]
    workers: list[subprocess.Popen[bytes]]


def until(condition: Callable[[], bool], limit_s: float = 600.0) -> None:
    end = time.monotonic() + limit_s
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.02)


def start(program: str, folder: Path, *args: str) -> subprocess.Popen[bytes]:
    return subprocess.Popen(
        [sys.executable, "-m", f"distributed.cli.{program}", "--scheduler-file", str(folder / "scheduler.json"), *args],
        cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip


@pytest.fixture(scope="module")
def room(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("cluster")
    (folder / "small.yaml").write_text(PARAMS)
    make_dive(folder / "dive", frames=FRAMES)
    return folder


@pytest.fixture
def cluster(room: Path) -> Iterator[Cluster]:
    scheduler = start("dask_scheduler", room, "--host", "127.0.0.1", "--port", "0", "--no-dashboard")
    workers: list[subprocess.Popen[bytes]] = []
    try:
        until((room / "scheduler.json").exists)
        with Client(scheduler_file=str(room / "scheduler.json"), set_as_default=False) as client:
            workers += [start("dask_worker", room, "--nthreads", "1", "--no-nanny", "--no-dashboard") for _ in range(2)]
            client.wait_for_workers(2, timeout=600)
            address = client.scheduler.address
        yield Cluster(address, scheduler, workers)
    finally:
        for process in [*workers, scheduler]:
            process.kill()
            process.wait()
        (room / "scheduler.json").unlink(missing_ok=True)


def arguments(room: Path, output: Path, *more: str) -> list[str]:
    return ["survey", str(room / "dive"), "-o", str(output), "--params", str(room / "small.yaml"), "--quiet", *more]


@pytest.mark.slow
def test_a_worker_killed_midway_changes_no_byte(room: Path, cluster: Cluster, tmp_path: Path) -> None:
    assert main(arguments(room, tmp_path / "local", "--jobs", "2")) == 0
    command = [sys.executable, "-m", "uw_recon_ros.cli"]
    survey = subprocess.Popen([*command, *arguments(room, tmp_path / "out", "--dask", cluster.address)])
    journal = tmp_path / "out" / "state" / "journal.jsonl"
    until(lambda: survey.poll() is not None or (journal.is_file() and journal.read_bytes().count(b"\n") >= 2))
    assert survey.poll() is None
    cluster.workers[0].kill()
    assert survey.wait() == 0
    assert digests(tmp_path / "out") == digests(tmp_path / "local")


def test_a_survey_begun_here_goes_on_there(room: Path, cluster: Cluster, tmp_path: Path) -> None:
    """What is compared is the work, not who did it."""
    few = ["--write", "disparity,depth"]
    assert main(arguments(room, tmp_path / "out", *few, "--jobs", "1")) == 0
    before = digests(tmp_path / "out")
    for name in ("000003.tiff", "000004.tiff"):
        (tmp_path / "out" / "depth" / name).unlink()
    assert main(arguments(room, tmp_path / "out", *few, "--dask", cluster.address)) == 0
    assert digests(tmp_path / "out") == before


def test_a_scheduler_killed_midway_is_one_line_and_the_work_goes_on(
    room: Path, cluster: Cluster, tmp_path: Path
) -> None:
    args = arguments(room, tmp_path / "out", "--write", "disparity")
    survey = subprocess.Popen(
        [sys.executable, "-m", "uw_recon_ros.cli", *args, "--dask", cluster.address], stderr=subprocess.PIPE, text=True
    )
    journal = tmp_path / "out" / "state" / "journal.jsonl"
    until(lambda: survey.poll() is not None or (journal.is_file() and b"\n" in journal.read_bytes()))
    assert survey.poll() is None
    cluster.scheduler.kill()
    _, err = survey.communicate()
    assert survey.returncode == 1
    assert "the scheduler is gone; the same command resumes there" in err
    assert err.count("\n") == 1
    assert main([*args, "--jobs", "1"]) == 0
    assert len(list((tmp_path / "out" / "disparity").iterdir())) == FRAMES


def test_no_scheduler_there(
    room: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("uw_recon_ros.survey.executor._PATIENCE_S", 1)
    assert main(arguments(room, tmp_path / "out", "--dask", "tcp://127.0.0.1:9")) == 1
    assert "--dask tcp://127.0.0.1:9: expected a scheduler with workers there" in capsys.readouterr().err
