"""Draws that look random and are the same in the page's script: a hash of 0, 1, 2, ... and no state.

``report/measure_numbers.js`` has the same lines, so that a page and the command give one answer.
The mixer is lowbias32 (C. Wellons, public domain).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.types import Matrix

_WHOLE = 2.0**32


def _mixed(first: int, count: int) -> NDArray[np.uint32]:
    """Numbers `first`, `first` + 1, ... each as 32 bits without a pattern."""
    x: NDArray[np.uint32] = (np.arange(first, first + count, dtype=np.uint64) * 0x9E3779B9).astype(np.uint32)
    for shift, factor in ((16, 0x21F0AAAD), (15, 0x735A2D97)):
        x ^= x >> np.uint32(shift)
        x *= np.uint32(factor)
    x ^= x >> np.uint32(15)
    return x


def below(limit: int, count: int, first: int = 0) -> NDArray[np.int64]:
    """(count,) whole numbers from 0 to `limit` - 1."""
    return np.floor(_mixed(first, count) / _WHOLE * limit).astype(np.int64)


def normals(count: int, first: int = 0) -> Matrix:
    """(count,) numbers of mean 0 and standard deviation 1 (Box and Muller)."""
    pairs = _mixed(2 * first, 2 * count).astype(np.float64).reshape(count, 2)
    found: Matrix = np.sqrt(-2 * np.log((pairs[:, 0] + 0.5) / _WHOLE)) * np.cos(2 * np.pi * pairs[:, 1] / _WHOLE)
    return found
