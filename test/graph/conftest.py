"""The installed executables as processes, on a domain of their own."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from helpers.graph_bench import Bench, Graph


@pytest.fixture
def graph(tmp_path: Path) -> Iterator[Graph]:
    bench = Bench()
    graph = Graph(bench, tmp_path)
    yield graph
    graph.end()
    bench.close()
