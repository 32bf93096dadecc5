"""The nodes' linear algebra has one thread before anything loads it, unless the user wants more."""

import os
from types import SimpleNamespace

import pytest

from uw_recon_ros import executables, stop_signals

VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@pytest.mark.parametrize(("chosen", "expected"), [(None, "1"), ("2", "2")])
def test_nodes_begin_with_one_thread_of_linear_algebra(
    monkeypatch: pytest.MonkeyPatch, chosen: str | None, expected: str
) -> None:
    seen: list[str | None] = []
    for name in VARIABLES:
        monkeypatch.setenv(name, chosen or "")  # so that it is as before afterwards
        if chosen is None:
            monkeypatch.delenv(name)

    def loaded(module: str) -> SimpleNamespace:
        seen.extend(os.environ.get(name) for name in VARIABLES)
        return SimpleNamespace(main=lambda: 0)

    monkeypatch.setattr(executables, "import_module", loaded)
    monkeypatch.setattr(stop_signals, "note", lambda: None)
    monkeypatch.setattr(stop_signals, "leave", lambda code: None)
    executables.rectify_node()
    assert seen == [expected] * len(VARIABLES)
