"""Comparisons of a pixel with its neighbours: blind to offset and veil, and to gain once contrasts are made alike.

The census (Zabih and Woodfill, 1994) asks which neighbours are brighter. Where noise is strong that throws away most
of what a pair tells, for half of the signs are chance; so the words say in four steps by how much, and differences of
words count the steps that two differences of gray levels lie apart.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.match.planes.gray import CONTRAST

Words = NDArray[np.uint64]
Pattern = NDArray[np.int64]
ROWS, COLUMNS = 3, 4  #: half height and half width of the window of `census_words`; every second row and column of it
STEP_CLEAN, STEP_NOISY = 0.03, 0.8  #: where the steps between words lie: 0 and this part of the contrast
#: Neighbours, (24, 2) rows and columns: all of 5x5; every other row and column of 9x9.
CLOSE: Pattern = np.array([(v, u) for v in range(-2, 3) for u in range(-2, 3) if v or u])
WIDE: Pattern = np.array([(v, u) for v in range(-4, 5, 2) for u in range(-4, 5, 2) if v or u])
RADIUS = 4  #: of either


@kernel(allocates=False)
def _words(padded: NDArray[np.int16], step: np.int16, words: Words) -> None:
    """Of an image that is continued by `ROWS` and `COLUMNS` beyond its borders."""
    height, width = words.shape
    for v in range(height):
        row, centre = words[v], padded[v + ROWS, COLUMNS : COLUMNS + width]
        row[:] = 0
        for dv in range(0, 2 * ROWS + 1, 2):
            for du in range(0, 2 * COLUMNS + 1, 2):
                _append(centre, padded[v + dv, du : du + width], step, row)


@kernel(allocates=False)
def _append(centre: NDArray[np.int16], other: NDArray[np.int16], step: np.int16, words: Words) -> None:
    for u in range(words.size):
        apart = np.int16(other[u] - centre[u])
        bits = (np.uint64(apart > -step) << np.uint64(2)) | (np.uint64(apart > 0) << np.uint64(1))
        words[u] = (words[u] << np.uint64(3)) | bits | np.uint64(apart > step)


def census_words(gray: NDArray[np.int16], noise: float, first: int, last: int, words: Words) -> None:
    """Write three bits for each of 20 neighbours, rows `first` to `last`; the image is continued at its border.

    `noise` is that of `gray.gray_pair`.
    """
    step = np.int16(round(CONTRAST * (STEP_CLEAN + noise * (STEP_NOISY - STEP_CLEAN))))
    above, below = min(first, ROWS), min(gray.shape[0] - last, ROWS)
    seen = gray[first - above : last + below]
    padded = np.pad(seen, ((ROWS - above, ROWS - below), (COLUMNS, COLUMNS)), mode="edge")
    _words(padded, step, words[first:last])
