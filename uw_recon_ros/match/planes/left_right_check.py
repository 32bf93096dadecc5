"""What both views see: the left/right check, and why a pixel has no match."""

from __future__ import annotations

import cv2
import numpy as np

from uw_recon_ros.jit import kernel
from uw_recon_ros.types import ByteImage, FloatImage, Mask, Status

AGREE = 1.5  #: the views' disparities may differ by this, px
_OCCLUDED, _OUTSIDE, _INCONSISTENT = int(Status.OCCLUDED), int(Status.OUTSIDE), int(Status.INCONSISTENT)
ISLAND = 30  #: fewest pixels that hold a surface, px^2


@kernel
def left_right_check(
    disparity: FloatImage, right: FloatImage, low: int, high: int, first: int, last: int, status: ByteImage
) -> None:
    """Write `Status` bits of rows `first` to `last`: does the right view, where a pixel is seen, say the same?

    A pixel that the views disagree about is occluded where no disparity at all would satisfy both (Hirschmueller,
    2008), else inconsistent.
    """
    width = disparity.shape[1]
    for v in range(first, last):
        for u in range(width):
            at = np.float32(u) - disparity[v, u]
            if at < -0.5 or at > np.float32(width) - np.float32(0.5):
                status[v, u] = _OUTSIDE
                continue
            column = int(np.floor(at))
            agrees = False
            for x in range(max(column, 0), min(column + 2, width)):
                agrees |= abs(right[v, x] - disparity[v, u]) <= AGREE
            if agrees:
                status[v, u] = 0
                continue
            first_x = min(max(u - high, 0), width)
            explained = _any_matches(right[v, first_x : max(min(u - low + 1, width), first_x)], u - first_x)
            status[v, u] = _INCONSISTENT if explained else _OCCLUDED


@kernel(inline=True, allocates=False)
def _any_matches(right: FloatImage, apart: int) -> bool:
    """Whether any pixel of a part of a row matches the one that lies `apart` from the first of them, to a pixel."""
    matching = np.int32(0)
    for i in range(right.size):
        matching += np.int32(abs(right[i] - np.float32(np.int32(apart) - np.int32(i))) <= np.float32(1))
    return bool(matching > 0)


@kernel
def enforce_uniqueness(disparity: FloatImage, costs: FloatImage, first: int, last: int, status: ByteImage) -> None:
    """Write `Status` bits of rows `first` to `last`: a pixel of the right view belongs to one surface of the left view.

    Where pixels of the left view that lie more than a pixel of disparity apart fall onto the same pixel of the right
    view, the one with the least cost has it; the others are occluded. (Uniqueness, as in the reference energy. A nearer
    surface need not win: what bulges over its edge has no match and costs more than what is really seen there.)
    """
    width = disparity.shape[1]
    owner_cost, owner = np.empty(width, np.float32), np.empty(width, np.float32)
    for v in range(first, last):
        owner_cost[:] = np.inf
        for u in range(width):
            x = int(np.floor(np.float32(u) - disparity[v, u] + np.float32(0.5)))
            if 0 <= x < width and costs[v, u] < owner_cost[x]:
                owner_cost[x], owner[x] = costs[v, u], disparity[v, u]
        for u in range(width):
            at = np.float32(u) - disparity[v, u]
            if at < -0.5 or at > np.float32(width) - np.float32(0.5):
                status[v, u] = _OUTSIDE
                continue
            status[v, u] = 0
            column = int(np.floor(at))
            for x in range(max(column, 0), min(column + 2, width)):
                if owner_cost[x] < costs[v, u] and abs(owner[x] - disparity[v, u]) > 1:
                    status[v, u] = _OCCLUDED


@kernel(allocates=False)
def outside_by_surface(disparity: FloatImage, blank: Mask, status: ByteImage) -> None:
    """Mark as outside what is blank, at the left border, and would not be seen if it were of the surface it ends at.

    Parameters
    ----------
    disparity : (H, W) float32
        px.
    blank : (H, W) bool
        What has no texture, and so no disparity of its own.
    status : (H, W) uint8
    """
    height, width = disparity.shape
    for v in range(height):
        first = 0
        while first < width and status[v, first] != 0:
            first += 1
        for u in range(first if first < width else 0):
            if blank[v, u] and np.float32(u) - disparity[v, first] < -0.5:
                status[v, u] = _OUTSIDE


def remove_small_segments(disparity: FloatImage, status: ByteImage) -> None:
    """Mark as inconsistent what is valid in patches of less than `ISLAND` px, a step of 1 px ending a patch."""
    valid = status == 0
    if not valid.any():
        return
    lowest = disparity[valid].min()
    # filterSpeckles counts in 16-bit integers
    scale = min(16.0, 30000.0 / max(float(disparity[valid].max() - lowest), 1.0))
    levels = np.where(valid, np.round((disparity - lowest) * scale), -1).astype(np.int16)
    cv2.filterSpeckles(levels, -1, ISLAND, int(scale))
    status[valid & (levels < 0)] = _INCONSISTENT


def fill_background(disparity: FloatImage) -> FloatImage:
    """Give pixels without a disparity the smaller of their nearest neighbours on the row, else the median of all."""
    filled = np.asarray(disparity.copy())
    fill_rows(filled)
    known = np.isfinite(filled)
    if not known.all():
        filled[~known] = np.median(filled[known]) if known.any() else 0
    return filled


@kernel(allocates=False)
def fill_rows(disparity: FloatImage) -> None:
    """Give pixels without a disparity the smaller of their nearest neighbours on the row; rows without any keep NaN."""
    height, width = disparity.shape
    for v in range(height):
        u = 0
        while u < width:
            if np.isfinite(disparity[v, u]):
                u += 1
                continue
            end = u
            while end < width and not np.isfinite(disparity[v, end]):
                end += 1
            value = np.float32(np.inf)
            if u > 0:
                value = min(value, disparity[v, u - 1])
            if end < width:
                value = min(value, disparity[v, end])
            for x in range(u, end):
                disparity[v, x] = value if np.isfinite(value) else np.float32(np.nan)
            u = end
