"""The same work on a Dask cluster."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import CancelledError
from typing import Any, TypeVar

from uw_recon_ros.survey.executor import Lost
from uw_recon_ros.survey.store import SurveyError

T = TypeVar("T")
R = TypeVar("R")

_AHEAD = 2
_LOUD = ("distributed", "distributed.client", "distributed.utils", "distributed.core", "distributed.comm")
_PATIENCE_S = 30


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
                "--dask: expected the extra 'dask' to be installed: pip install uw_recon_ros[dask]"
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
        self._fill(work, fresh, in_flight, finished)
        while in_flight:
            future = next(finished)
            task = in_flight.pop(future)
            try:
                result: R | Lost = future.result()
            except CancelledError as error:
                raise SurveyError(
                    f"--dask {self._address}: the scheduler is gone; the same command goes on from there"
                ) from error
            except KilledWorker as error:
                result = Lost(
                    f"its Dask worker died too often ({error.last_worker.address if error.last_worker else ''})"
                )
            future.release()
            self._fill(work, fresh, in_flight, finished)
            yield task, result

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
