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


@kernel
def _words(gray: NDArray[np.int16], step: int, first: int, last: int, words: Words) -> None:
    height, width = gray.shape
    for v in range(first, last):
        for u in range(width):
            centre, word = int(gray[v, u]), np.uint64(0)
            for dv in range(-ROWS, ROWS + 1, 2):
                y = min(max(v + dv, 0), height - 1)
                for du in range(-COLUMNS, COLUMNS + 1, 2):
                    x = min(max(u + du, 0), width - 1)
                    apart = int(gray[y, x]) - centre
                    word = (word << np.uint64(1)) | np.uint64(apart > -step)
                    word = (word << np.uint64(1)) | np.uint64(apart > 0)
                    word = (word << np.uint64(1)) | np.uint64(apart > step)
            words[v, u] = word


def census_words(gray: NDArray[np.int16], noise: float, first: int, last: int, words: Words) -> None:
    """Write three bits for each of 20 neighbours, rows `first` to `last`; the image is continued at its border.

    `noise` is that of `gray.gray_pair`.
    """
    _words(gray, round(CONTRAST * (STEP_CLEAN + noise * (STEP_NOISY - STEP_CLEAN))), first, last, words)
