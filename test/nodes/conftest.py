from __future__ import annotations

from collections.abc import Iterator

import pytest
from ros_bench import Bench


@pytest.fixture(scope="session", autouse=True)
def warm(kernels_compiled: None) -> None:
    """Every test in here finds the kernels compiled."""


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.close()
