"""What all tests share."""

from __future__ import annotations

from pathlib import Path

import pytest

# Over real DDS, discovery between processes now and then misses a first message on a busy machine; that is the
# middleware's, and not what these tests are about. Every other test has one try.
OVER_DDS = {"graph", "nodes"}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if OVER_DDS & set(Path(item.path).parts):
            item.add_marker(pytest.mark.flaky(reruns=2, reruns_delay=1))
