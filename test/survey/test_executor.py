"""Tasks survive the processes that work on them."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.survey_tasks import die_if_seven, die_once, full_disk, process_number, square, threads

from uw_recon_ros.survey.executor import LocalExecutor, Lost


@pytest.fixture
def two() -> Iterator[LocalExecutor]:
    executor = LocalExecutor(2)
    yield executor
    executor.close()


def test_every_task_comes_back_once(two: LocalExecutor) -> None:
    assert sorted(two.run(square, range(50))) == [(i, i * i) for i in range(50)]


def test_work_is_spread_over_processes(two: LocalExecutor) -> None:
    pids = {value for _, value in two.run(process_number, range(12))}
    assert len(pids) == 2
    assert os.getpid() not in pids


def test_tasks_are_drawn_as_places_become_free(two: LocalExecutor) -> None:
    drawn: list[int] = []
    results = two.run(square, (drawn.append(i) or i for i in range(1000)))  # type: ignore[func-returns-value]
    for done, _ in enumerate(results, 1):
        assert len(drawn) <= done + 2 * two.jobs


def test_a_task_that_kills_its_process_is_given_up_and_the_others_are_not(two: LocalExecutor) -> None:
    results = dict(two.run(die_if_seven, range(12)))
    assert {task: value for task, value in results.items() if task != 7} == {i: i for i in range(12) if i != 7}
    assert isinstance(results[7], Lost)
    assert "died 2 times" in results[7].reason


def test_a_process_killed_once_costs_no_task(two: LocalExecutor, tmp_path: Path) -> None:
    markers = [str(tmp_path / f"{i}") for i in range(3)]
    results = dict(two.run(die_once, markers))
    assert results == {marker: Path(marker).name for marker in markers}


def test_an_idle_process_killed_costs_nothing(two: LocalExecutor) -> None:
    assert len(list(two.run(square, range(4)))) == 4
    for pid in list(two._pool._processes):  # type: ignore[union-attr]
        os.kill(pid, signal.SIGKILL)
    time.sleep(0.2)
    assert len(list(two.run(square, range(4)))) == 4


def test_a_full_disk_stops_the_work(two: LocalExecutor) -> None:
    with pytest.raises(OSError, match="No space left"):
        list(two.run(full_disk, range(10)))


def test_processes_compute_on_one_thread_and_this_one_is_left_alone(two: LocalExecutor) -> None:
    before = os.environ.get("OMP_NUM_THREADS")
    assert {value for _, value in two.run(threads, range(3))} == {"1"}
    assert os.environ.get("OMP_NUM_THREADS") == before


@pytest.mark.parametrize("jobs", [0, -1])
def test_no_processes_are_refused(jobs: int) -> None:
    with pytest.raises(ValueError, match="jobs: expected >= 1"):
        LocalExecutor(jobs)


def test_processes_end_when_their_parent_is_killed(tmp_path: Path) -> None:
    code = (
        "from helpers.survey_tasks import note_and_sleep\nfrom uw_recon_ros.survey.executor import LocalExecutor\n"
        f"if __name__ == '__main__': list(LocalExecutor(1).run(note_and_sleep, [{str(tmp_path / 'pid')!r}]))\n"
    )
    script = tmp_path / "main.py"
    script.write_text(code)
    environment = os.environ | {"PYTHONPATH": str(Path(__file__).parents[1])}
    parent = subprocess.Popen([sys.executable, str(script)], env=environment)
    _until(lambda: (tmp_path / "pid").exists() and (tmp_path / "pid").read_text() != "")
    worker = int((tmp_path / "pid").read_text())
    parent.kill()
    parent.wait()
    _until(lambda: not _lives(worker))


def _lives(pid: int) -> bool:
    stat = Path(f"/proc/{pid}/stat")
    try:
        return stat.read_text().rsplit(")", 1)[1].split()[0] != "Z"
    except OSError:
        return False


def _until(condition: object, limit_s: float = 600.0) -> None:
    end = time.monotonic() + limit_s
    while not condition():  # type: ignore[operator]
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.05)
