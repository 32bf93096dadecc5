"""What every door of this room asks of an array before it opens."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[Any]  #: float32 or float64, whichever came in


def checked_float(name: str, image: Any, *, shape: str = "(H, W)") -> FloatArray:
    """Return `image` as a contiguous float32 or float64 array.

    Parameters
    ----------
    name : str
        The argument's name, for the error text.
    image : array_like
    shape : {'(H, W)', '(H, W, 3)', '(H, W) or (H, W, 3)'}
        What is expected.

    Raises
    ------
    TypeError
        Not float32 or float64.
    ValueError
        Another shape, no pixels, NaN or infinity.
    """
    array = np.asarray(image)
    if array.dtype.char not in "fd":
        raise TypeError(f"{name}: expected float32 or float64, got {array.dtype}")
    if not _has_shape(array, shape):
        raise ValueError(f"{name}: expected shape {shape} with at least one pixel, got {array.shape}")
    array = np.ascontiguousarray(array)
    with np.errstate(over="ignore", invalid="ignore"):
        finite = bool(np.isfinite(array.sum()))  # three times as quick as the check, but may overflow
    if not finite and not cv2.checkRange(array)[0]:
        bad = int(array.size - np.count_nonzero(np.isfinite(array)))
        raise ValueError(f"{name}: expected finite values, got {bad} NaN or infinite of {array.size}")
    return array


def _has_shape(array: NDArray[Any], shape: str) -> bool:
    kinds = {"(H, W)": 2, "(H, W, 3)": 3}
    allowed = [ndim for kind, ndim in kinds.items() if kind in shape]
    return array.ndim in allowed and array.shape[2:] in ((), (3,)) and array.size > 0


def checked_number(name: str, value: float, low: float, high: float) -> float:
    """Return `value` as a float.

    Raises
    ------
    ValueError
        It lies outside [`low`, `high`], or is NaN.
    """
    if not low <= value <= high:
        raise ValueError(f"{name}: expected a number in [{low:g}, {high:g}], got {value!r}")
    return float(value)
