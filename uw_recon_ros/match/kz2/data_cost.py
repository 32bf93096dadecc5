"""The data cost of the reference energy: how much two pixels of a row differ, blind to where the sampling grid fell."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.types import ByteImage

CUT = 30  #: each channel's difference is cut here, gray levels
EDGE = 8  #: from this difference of neighbouring pixels on, gray levels, there is an edge between them
SMOOTH_RIGHT, SMOOTH_DOWN = 1, 2  #: bits of `IntervalImage.smooth`

Costs = NDArray[np.int16]


class IntervalImage(NamedTuple):
    """One view's image, prepared for matching.

    Parameters
    ----------
    value, low, high : (C, H, W) uint8
        A pixel, and the least and the greatest of it and the half-way values to its four neighbours.
    smooth : (H, W) uint8
        Whether there is no edge towards the right neighbour (bit 0) and towards the lower one (bit 1).
    """

    value: ByteImage
    low: ByteImage
    high: ByteImage
    smooth: ByteImage


def make_interval_image(image: ByteImage) -> IntervalImage:
    """Prepare an image, (H, W) or (H, W, C) uint8."""
    planes = np.ascontiguousarray(np.moveaxis(np.atleast_3d(image), 2, 0))
    low, high = planes.copy(), planes.copy()
    smooth = np.zeros(planes.shape[1:], np.uint8)
    for axis, bit in ((2, SMOOTH_RIGHT), (1, SMOOTH_DOWN)):
        here, there = _neighbours(axis)
        _widen(low, high, planes, here, there)
        difference = np.abs(planes[here].astype(np.int16) - planes[there]).max(axis=0)
        smooth[here[1:]] |= np.uint8(bit) * (difference < EDGE)
    return IntervalImage(planes, low, high, smooth)


def _neighbours(axis: int) -> tuple[tuple[slice, ...], tuple[slice, ...]]:
    """Indices of a (C, H, W) array: all pixels that have a next one along `axis`, and those next ones."""
    here, there = [slice(None)] * 3, [slice(None)] * 3
    here[axis], there[axis] = slice(None, -1), slice(1, None)
    return tuple(here), tuple(there)


def _widen(
    low: ByteImage, high: ByteImage, planes: ByteImage, here: tuple[slice, ...], there: tuple[slice, ...]
) -> None:
    """Take the half-way values between neighbours into the intervals of both."""
    half = ((planes[here].astype(np.uint16) + planes[there]) // 2).astype(np.uint8)
    for side in (here, there):
        np.minimum(low[side], half, out=low[side])
        np.maximum(high[side], half, out=high[side])


@kernel
def row_costs(left: IntervalImage, right: IntervalImage, row: int, start: int, disparity: int, costs: Costs) -> None:
    """Write the cost of the assignments (u, u - disparity) of a row, u = start, start + 1, ... as far as `costs` goes.

    The symmetric measure of Birchfield and Tomasi (1998): the distance of either pixel from the other one's interval,
    the smaller of the two; cut, squared, mean over the channels (rounded down). All pixels must lie in the images.
    """
    stop = start + costs.size
    channels = left.value.shape[0]
    for channel in range(channels):
        _add_channel(
            left.value[channel, row, start:stop],
            left.low[channel, row, start:stop],
            left.high[channel, row, start:stop],
            right.value[channel, row, start - disparity : stop - disparity],
            right.low[channel, row, start - disparity : stop - disparity],
            right.high[channel, row, start - disparity : stop - disparity],
            costs,
            channel == 0,
        )
    if channels == 3:
        for u in range(costs.size):
            costs[np.uint64(u)] = (costs[np.uint64(u)] * 21846) >> 16  # a third, exactly, below 3 CUT^2


@kernel
def _add_channel(p, p_low, p_high, q, q_low, q_high, costs, first):  # type: ignore[no-untyped-def]
    """One channel's squared distances. Unsigned indices and 16-bit values: the compiler vectorises."""
    for i in range(costs.size):
        u = np.uint64(i)
        x, y = np.int16(p[u]), np.int16(q[u])
        to_right = max(np.int16(q_low[u] - x), np.int16(x - q_high[u]))
        to_left = max(np.int16(p_low[u] - y), np.int16(y - p_high[u]))
        distance = min(max(min(to_left, to_right), np.int16(0)), np.int16(CUT))
        costs[u] = distance * distance if first else costs[u] + distance * distance
