"""The part of a rectified pair that is worth matching: what rectifying left black at the borders is not."""

from __future__ import annotations

from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.types import MatchingPair, Window

T = TypeVar("T", bound=np.generic)


def window_to_match(pair: MatchingPair) -> Window:
    """The rows that both valid windows have, and the columns that either has; in a vertical rig the other way round.

    The same part of both views, so that disparities stay what they are.

    Raises
    ------
    EstimationError
        The windows have no rows in common.
    """
    height, width = pair.left.shape[:2]
    whole = Window(0, 0, width, height)
    left, right = pair.valid_left or whole, pair.valid_right or whole
    rows = [(w.v, w.v + w.height) for w in (left, right)]
    columns = [(w.u, w.u + w.width) for w in (left, right)]
    vertical = pair.axis == "vertical"
    across, along = (columns, rows) if vertical else (rows, columns)
    first, last = max(a for a, _ in across), min(b for _, b in across)
    if first >= last:
        name = "columns" if vertical else "rows"
        raise EstimationError(f"valid windows of the rectified views: expected {name} in common, got {left}, {right}")
    start, stop = min(a for a, _ in along), max(b for _, b in along)
    if vertical:
        return Window(first, start, last - first, stop - start)
    return Window(start, first, stop - start, last - first)


def paste(found: NDArray[T], window: Window, shape: tuple[int, ...], elsewhere: T) -> NDArray[T]:
    """An image of `shape` with what was found in a window of it, `elsewhere` in the rest."""
    if found.shape == shape:
        return found
    image = np.full(shape, elsewhere, found.dtype)
    image[window.slices] = found
    return image
