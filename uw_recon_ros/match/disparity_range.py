"""The range of disparities to search, from the images."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.findings import Code
from uw_recon_ros.match.coarse_disparities import COARSE_WIDTH, coarse_disparities
from uw_recon_ros.types import ByteImage

_LEAST_MATCHES = 40  # pixels of the small images
_SUPPORT = 1e-4  # part of all matches that a disparity needs behind it, for each step from the next one that has it
_LEAST_SUPPORT = 3  # and this number
_MARGIN = 1.5  # pixels of the small images, added at either end ...
_SLACK = 0.05  # ... and this part of the range
#: How far beyond what is found the rest may lie, as parts of the range, where nothing at all matches beyond doubt:
#: water and noise hide the far more than the near (``test/benchmark/match_range.py``).
_FARTHER, _NEARER = 0.6, 0.3


def find_disparity_range(left: ByteImage, right: ByteImage) -> tuple[int, int]:
    """Limits between which the disparities of a rectified pair lie.

    Seen at two sizes, of which the smaller stands more noise. The less of the images matches beyond doubt, the further
    beyond it the limits lie, to infinity (0) at most.

    Parameters
    ----------
    left, right : (H, W) uint8
        Rows matching.

    Returns
    -------
    min_disparity, max_disparity : int
        Inclusive, px; at least two labels, all smaller than the width.

    Raises
    ------
    EstimationError
        Too little of the images can be matched.
    """
    gray = (left, right)
    disparities, scale, textured = coarse_disparities(*gray)
    if disparities.size < _LEAST_MATCHES:
        raise EstimationError(
            f"disparity range: expected at least {_LEAST_MATCHES} pixels that match beyond doubt, got"
            f" {disparities.size} of {textured} textured ones ({left.shape[1]} x {left.shape[0]} px pair);"
            " give min_disparity and max_disparity", Code.MATCH_NO_RANGE,
        )  # fmt: skip
    low, high = (end * scale for end in _supported(disparities))
    smaller, coarser, _ = coarse_disparities(*gray, COARSE_WIDTH // 2)
    if smaller.size >= _LEAST_MATCHES:
        least, greatest = _supported(smaller)
        low, high = min(low, least * coarser), max(high, greatest * coarser)
    margin = _MARGIN * scale + _SLACK * (high - low)
    hidden = _hidden(disparities.size * scale**2, low, high, left.shape) * (high - low)
    farthest = min(low - margin, max(low - margin - _FARTHER * hidden, 0.0))
    nearest = high + margin + _NEARER * hidden
    widest = max(left.shape[1] - 1, 1)
    lowest = min(max(math.floor(farthest), -widest), widest - 1)
    highest = min(math.ceil(nearest), widest)
    return lowest, max(highest, lowest + 1)


def _hidden(matched: float, low: float, high: float, shape: tuple[int, ...]) -> float:
    """Part of what both views can show that does not match beyond doubt."""
    both = shape[0] * (shape[1] - max(high, 0.0, -low))
    return min(max(1 - matched / max(both, 1.0), 0.0), 1.0)


def _supported(disparities: NDArray[np.int32]) -> tuple[int, int]:
    """Least and greatest disparity, strays left out: the further off, the more matches must speak for it."""
    values, counts = np.unique(disparities, return_counts=True)
    start = int(np.searchsorted(values, np.median(disparities)))
    need = max(_LEAST_SUPPORT, _SUPPORT * disparities.size)
    low = high = int(values[start])
    for value, count in zip(values[start:], counts[start:], strict=True):
        high = int(value) if count >= need * (value - high) else high
    for value, count in zip(values[start::-1], counts[start::-1], strict=True):
        low = int(value) if count >= need * (low - value) else low
    return low, high
