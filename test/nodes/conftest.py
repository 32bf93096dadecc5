from __future__ import annotations

from collections.abc import Iterator

import pytest
from ros_bench import Bench

from uw_recon_ros.warm import warm_up


@pytest.fixture(scope="session", autouse=True)
def compiled() -> None:
    """All kernels, so that no test waits for the compiler where it waits for messages."""
    warm_up()


@pytest.fixture(scope="session", autouse=True)
def warm(kernels_compiled: None) -> None:
    """Every test in here finds the kernels compiled."""


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.close()
