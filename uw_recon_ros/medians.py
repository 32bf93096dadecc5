"""The median of many values."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def median(values: NDArray[Any]) -> float:
    """As ``numpy.median``, which takes several times as long: it looks for NaN, and for both middle ones at once.

    Parameters
    ----------
    values : (...) float32 or float64
        At least one, none NaN.
    """
    flat = values.ravel()
    half = len(flat) // 2
    parted = np.partition(flat, half)
    lower = parted[half] if len(flat) % 2 else parted[:half].max()
    return 0.5 * (float(lower) + float(parted[half]))
