"""Frames handed out to processes, a few at a time, whatever becomes of a process.

Two executors, one interface: `run(work, tasks)` yields ``(task, value)`` in the order in which they are finished. The
distribution itself is left to `concurrent.futures` and to Dask.
"""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import resource_tracker
from multiprocessing.connection import wait as wait_for
from multiprocessing.context import BaseContext
from typing import Any, Generic, Protocol, TypeVar

from uw_recon_ros.survey.store import SurveyError

T = TypeVar("T")
R = TypeVar("R")

#: Libraries compute on one thread in each process: frames are what is spread over the cores.
SINGLE_THREADED = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
_PRELOADED = ["uw_recon_ros.survey.worker"]
_AHEAD = 2  # tasks in flight a process: one at work, one waiting
_LOUD = ("distributed", "distributed.client", "distributed.utils", "distributed.core", "distributed.comm")
_PATIENCE_S = 30


@dataclass(frozen=True)
class Lost:
    """What comes of a task that killed its process each time.

    Parameters
    ----------
    reason : str
    """

    reason: str


class Executor(Protocol):
    """Something that works on tasks elsewhere."""

    @property
    def description(self) -> str:
        """What and how many, for the report."""

    def run(self, work: Callable[[T], R], tasks: Iterable[T]) -> Iterator[tuple[T, R | Lost]]:
        """Work on all tasks, a bounded number at a time; yield each with its result as it is done.

        `tasks` is drawn from only as places become free. An exception of `work` is raised here.
        """

    def close(self) -> None:
        """Stop all work at once."""


@dataclass
class _Try(Generic[T]):
    task: T
    deaths: int = 0


class LocalExecutor:
    """Processes of this machine.

    A process that dies takes the whole pool of `concurrent.futures` with it and does not say which task it was at. So
    the tasks in flight are then tried again one by one; one that kills its process `patience` times while it is alone
    is given up.

    Parameters
    ----------
    jobs : int
        Processes.
    patience : int
    """

    def __init__(self, jobs: int, patience: int = 2) -> None:
        if jobs < 1:
            raise ValueError(f"jobs: expected >= 1, got {jobs}")
        self.jobs, self._patience = jobs, patience
        self._pool: ProcessPoolExecutor | None = None

    @property
    def description(self) -> str:
        """As in `Executor`."""
        return "one local process" if self.jobs == 1 else f"{self.jobs} local processes"

    def _running(self) -> ProcessPoolExecutor:
        if self._pool is None:
            self._pool = ProcessPoolExecutor(self.jobs, mp_context=_context(), initializer=_settle_in)
        return self._pool

    def run(self, work: Callable[[T], R], tasks: Iterable[T]) -> Iterator[tuple[T, R | Lost]]:
        """As in `Executor`."""
        fresh = iter(tasks)
        suspects: deque[_Try[T]] = deque()
        in_flight: dict[Future[R], _Try[T]] = {}
        while self._fill(work, fresh, suspects, in_flight):
            done, _ = wait(in_flight, return_when=FIRST_COMPLETED)
            broken: list[_Try[T]] = []
            for future in done:
                attempt = in_flight.pop(future)
                try:
                    value = future.result()
                except BrokenProcessPool:
                    broken.append(attempt)
                else:
                    yield attempt.task, value
            if broken:
                yield from self._bury(broken, in_flight, suspects)

    def _fill(
        self, work: Callable[[T], R], fresh: Iterator[T], suspects: deque[_Try[T]], in_flight: dict[Future[R], _Try[T]]
    ) -> bool:
        """Hand out tasks: suspects alone, others up to the limit. Whether any is in flight."""
        if suspects:
            if not in_flight:
                self._submit(work, suspects.popleft(), in_flight)
            return True
        while len(in_flight) < self.jobs * _AHEAD:
            for task in fresh:
                self._submit(work, _Try(task), in_flight)
                break
            else:
                break
        return bool(in_flight)

    def _submit(self, work: Callable[[T], R], attempt: _Try[T], in_flight: dict[Future[R], _Try[T]]) -> None:
        try:
            with _environment(dict.fromkeys(SINGLE_THREADED, "1")), _deaf():  # a process may be started by this
                future = self._running().submit(work, attempt.task)
        except BrokenProcessPool:  # a process died while it was idle, or a moment ago
            future = Future()
            future.set_exception(BrokenProcessPool())
        in_flight[future] = attempt

    def _bury(
        self, broken: list[_Try[T]], in_flight: dict[Future[R], _Try[T]], suspects: deque[_Try[T]]
    ) -> Iterator[tuple[T, R | Lost]]:
        """After a death: all that was in flight comes again, one by one."""
        self.close()
        alone = len(broken) == 1 and not in_flight
        for future, attempt in list(in_flight.items()):
            if future.done() and not future.cancelled() and future.exception() is None:
                yield attempt.task, future.result()
            else:
                broken.append(attempt)
        in_flight.clear()
        for attempt in broken:
            attempt.deaths += alone
            if attempt.deaths >= self._patience:
                yield attempt.task, Lost(f"its process died {attempt.deaths} times (killed; out of memory?)")
            else:
                suspects.append(attempt)

    def close(self) -> None:
        """As in `Executor`."""
        pool, self._pool = self._pool, None
        if pool is not None:
            for process in list((getattr(pool, "_processes", None) or {}).values()):
                process.kill()  # nothing is lost: files appear whole or not at all
            pool.shutdown(wait=True, cancel_futures=True)


@contextmanager
def _environment(values: dict[str, str]) -> Iterator[None]:
    """Environment variables for the processes started meanwhile."""
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def _deaf() -> Iterator[None]:
    """Put SIGINT off here, and hold it back for good in processes started meanwhile: it reaches them as they load.

    A process whose start was broken off would be known to nobody, and complain of what its parent took away.
    """
    resource_tracker.ensure_running()  # its start lets SIGINT through again, so it comes first
    handler, came = signal.getsignal(signal.SIGINT), threading.Event()
    if handler is None or threading.current_thread() is not threading.main_thread():  # which alone is interrupted
        with _blocked():
            yield
        return
    signal.signal(
        signal.SIGINT, lambda number, frame: came.set()
    )  # any thread may be sent it, whatever this one blocks
    try:
        with _blocked():
            yield
    finally:
        signal.signal(signal.SIGINT, handler)
        if came.is_set():
            signal.raise_signal(signal.SIGINT)


@contextmanager
def _blocked() -> Iterator[None]:
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _context() -> BaseContext:
    """Never fork: threads and locks of this process would come along."""
    if "forkserver" not in multiprocessing.get_all_start_methods():
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload(_PRELOADED)
    return context


def _settle_in() -> None:
    """First thing in a process: Ctrl-C stays the parent's business; without a parent there is nothing to work for."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:
        threading.Thread(target=_die_with, args=(parent.sentinel,), daemon=True).start()


def _die_with(sentinel: Any) -> None:
    wait_for([sentinel])
    os._exit(1)


class DaskExecutor:
    """Processes on any machines, through a Dask scheduler.

    All machines see the input and the output directory under the same path and have the same versions installed. The
    frames of a worker that dies are given to others by the scheduler.

    Parameters
    ----------
    address : str
        Of the scheduler, e.g. ``tcp://10.0.0.1:8786``.

    Raises
    ------
    SurveyError
        Dask is not installed, the scheduler does not answer, or it has no workers.
    """

    def __init__(self, address: str) -> None:
        try:
            from distributed import Client
        except ImportError as error:
            raise SurveyError(
                "--dask: expected the extra 'dask' to be installed: pip install '.[dask]' in the sources' folder"
            ) from error
        for name in _LOUD:
            logging.getLogger(name).setLevel(logging.CRITICAL)  # what matters comes as an exception, in one line
        try:
            self._client: Any = Client(address, timeout=_PATIENCE_S, set_as_default=False)
            self._client.wait_for_workers(1, timeout=_PATIENCE_S)
        except (OSError, TimeoutError, ValueError) as error:
            raise SurveyError(f"--dask {address}: expected a scheduler with workers there: {error}") from error
        self._address = address

    @property
    def description(self) -> str:
        """As in `Executor`."""
        return f"Dask cluster {self._address}, {len(self._client.nthreads())} workers"

    def run(self, work: Callable[[T], R], tasks: Iterable[T]) -> Iterator[tuple[T, R | Lost]]:
        """As in `Executor`."""
        from distributed import as_completed
        from distributed.scheduler import KilledWorker

        in_flight: dict[Any, T] = {}
        fresh = iter(tasks)
        finished = as_completed(loop=self._client.loop)
        with self._scheduler():
            self._fill(work, fresh, in_flight, finished)
        while in_flight:
            with self._scheduler():
                future = next(finished)
                task = in_flight.pop(future)
                try:
                    result: R | Lost = future.result()
                except KilledWorker as error:
                    result = Lost(
                        f"its Dask worker died too often ({error.last_worker.address if error.last_worker else ''})"
                    )
                future.release()
                self._fill(work, fresh, in_flight, finished)
            yield task, result

    @contextmanager
    def _scheduler(self) -> Iterator[None]:
        """Whatever a scheduler's end breaks, a task or a question to it, is told as that."""
        from distributed.comm import CommClosedError

        try:
            yield
        except (CancelledError, CommClosedError) as error:
            raise SurveyError(
                f"--dask {self._address}: the scheduler is gone; the same command resumes there"
            ) from error

    def _fill(self, work: Callable[[T], R], fresh: Iterator[T], in_flight: dict[Any, T], finished: Any) -> None:
        """Keep every thread of the cluster busy, as it is now: workers come and go."""
        limit = max(1, _AHEAD * sum(self._client.nthreads().values()))
        while len(in_flight) < limit:
            for task in fresh:
                future = self._client.submit(work, task, pure=False)
                in_flight[future] = task
                finished.add(future)
                break
            else:
                return

    def close(self) -> None:
        """As in `Executor`."""
        self._client.close()
