"""Maps that are larger than the memory: counted band by band, and their room on the disk taken first."""

from __future__ import annotations

import errno
import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from uw_recon_ros.model import maps


def outlined(known: np.ndarray) -> int:
    """Cells between the first and the last known one of their row and of their column, from the definition."""
    count = 0
    for row in range(known.shape[0]):
        for column in range(known.shape[1]):
            along, across = np.flatnonzero(known[row]), np.flatnonzero(known[:, column])
            if len(along) and len(across):
                count += along[0] <= column <= along[-1] and across[0] <= row <= across[-1]
    return count


@given(st.integers(1, 17), st.integers(1, 9), st.floats(0, 1), st.integers(0, 2**31), st.integers(1, 6))
def test_cells_are_counted_as_without_bands(rows: int, columns: int, share: float, seed: int, band: int) -> None:
    known = np.random.default_rng(seed).uniform(size=(rows, columns)) < share
    heights = np.where(known, 1.0, np.nan).astype(np.float32)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(maps, "_AT_ONCE", band)
        assert maps._counted(heights) == (known.sum(), outlined(known))


def test_a_map_without_room_is_an_error_and_no_death(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A file mapped into memory that the disk has no room for kills whoever writes into it."""

    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    maps._on_disk(tmp_path / "some.npy", np.dtype(np.float32), (300, 200))[:] = 1
    assert (np.load(tmp_path / "some.npy") == 1).all()
    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(OSError, match="No space"):
        maps._on_disk(tmp_path / "none.npy", np.dtype(np.float32), (300, 200))
