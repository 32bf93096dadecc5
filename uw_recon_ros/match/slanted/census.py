"""Census transform (Zabih and Woodfill, 1994): which neighbours are brighter. Blind to gain, offset and veil."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel

Words = NDArray[np.uint64]
ROWS, COLUMNS = 3, 4  #: half height and half width of the window of `census_words`: 62 comparisons


@kernel
def _words(gray: NDArray[np.int16], first: int, last: int, words: Words) -> None:
    height, width = gray.shape
    for v in range(first, last):
        for u in range(width):
            centre, word = gray[v, u], np.uint64(0)
            for dv in range(-ROWS, ROWS + 1):
                y = min(max(v + dv, 0), height - 1)
                for du in range(-COLUMNS, COLUMNS + 1):
                    if dv != 0 or du != 0:
                        x = min(max(u + du, 0), width - 1)
                        word = (word << np.uint64(1)) | np.uint64(gray[y, x] > centre)
            words[v, u] = word


def census_words(gray: NDArray[np.int16], first: int, last: int, words: Words) -> None:
    """Write one bit per neighbour in a 9x7 window, rows `first` to `last`; the image is continued at its border."""
    _words(gray, first, last, words)
