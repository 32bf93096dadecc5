"""The data cost of a plane: local differences after the other view is bent along the plane, averaged over crosses.

A window that stays parallel to the image plane compares the wrong pixels where a surface is steep: on a floor that
gains a pixel of disparity a row nothing matches. So the window is slanted with the plane: the other view is read at
``u - d(u, v)``, between the pixels, and only then are neighbours compared. The cost of a plane at a pixel depends on
nothing else, in particular not on the tile in which it is asked for.

A pixel's cost compares its differences from 24 neighbours with those in the other view. Half of it is the census, that
is whether they have the same sign, which gain and offset leave alone; half is by how much they differ, cut at a part of
the image's contrast, which tells more where texture is weak.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.match.slanted.census import RADIUS
from uw_recon_ros.match.slanted.support import REACH, Arms
from uw_recon_ros.types import FloatImage

QUARTERS = 4  #: samples a pixel in `View.other`
SOFTNESS = 0.6  #: part of the local contrast at which the difference between differences is cut
SIZES_COUNT, SIGNS_ONLY = (
    0.15,
    0.3,
)  #: noise / contrast up to which sizes and signs weigh alike, and beyond which only signs
CUT, CUT_NOISY = 0.4, 0.333  #: a pixel's cost is cut at this part of the largest possible; where noise is strong
OUTSIDE = 1.0  #: cost of a match outside the other view; 2 is the worst cost of all
FORBIDDEN = 4.0  #: cost of a disparity outside the limits


class View(NamedTuple):
    """All that the costs of planes need.

    Parameters
    ----------
    differences : (24, H, W) int16
        Of this view; see `census.difference_planes`.
    softness, sign : int16
        Where the difference between differences is cut, and what another sign costs, 1/16 gray level.
    most : float32
        Where a pixel's cost is cut, 1/16 gray level.
    other : (H, 4 W - 3) int16
        The other view, four samples a pixel, 1/16 gray level.
    arms : (4, H, W) uint8
    inverse_size : (H, W) float32
        Of `support`.
    low, high : float32
        Limits of the disparity, px.
    """

    differences: NDArray[np.int16]
    softness: np.int16
    sign: np.int16
    most: np.float32
    other: NDArray[np.int16]
    arms: Arms
    inverse_size: FloatImage
    low: np.float32
    high: np.float32


def weigh(contrast: float, noise_to_contrast: float) -> tuple[np.int16, np.int16, np.float32]:
    """`View.softness`, `View.sign` and `View.most` for an image of some local contrast, 1/16 gray level.

    The more noise against the contrast, the less the size of a difference counts against its sign.
    """
    noise = float(np.clip((noise_to_contrast - SIZES_COUNT) / (SIGNS_ONLY - SIZES_COUNT), 0, 1))
    largest = float(np.clip(SOFTNESS * contrast, 16, 600))
    softness = round(largest * (1 - noise))
    sign = round(2 * largest) - softness
    part = CUT + (CUT_NOISY - CUT) * noise
    return np.int16(softness), np.int16(sign), np.float32(part * 24 * (softness + sign))


class Desk(NamedTuple):
    """Working memory of one thread."""

    bent: NDArray[np.int16]
    differing: NDArray[np.int16]
    prefix: FloatImage
    rows: FloatImage
    cost: FloatImage


def make_desk(side: int) -> Desk:
    """Memory for regions of at most `side` x `side` pixels."""
    wide = side + 2 * REACH
    return Desk(
        np.zeros((wide + 2 * RADIUS, wide + 2 * RADIUS), np.int16),
        np.zeros(wide, np.int16),
        np.zeros(wide + 1, np.float32),
        np.zeros((wide, side), np.float32),
        np.zeros((side, side), np.float32),
    )


@kernel
def plane_cost(
    a: float, b: float, c: float, top: int, bottom: int, left: int, right: int, view: View, desk: Desk
) -> None:
    """Write the cost of disparity ``a u + b v + c`` for the pixels of a region into ``desk.cost``."""
    height, width = view.inverse_size.shape
    first, last = max(0, top - REACH), min(height, bottom + REACH)
    start, stop = max(0, left - REACH), min(width, right + REACH)
    _bend(a, b, c, first, last, start, stop, height, width, view.other, desk.bent)
    for v in range(first, last):
        _compare(v - first, v, start, stop, desk.bent, view.differences, view.softness, view.sign, desk.differing)
        _prefix(
            a, b * np.float32(v) + c, start, stop, width, view.low, view.high, view.most, desk.differing, desk.prefix
        )
        for u in range(left, right):
            ahead, behind = np.int64(view.arms[1, v, u]), np.int64(view.arms[0, v, u])
            desk.rows[v - first, u - left] = desk.prefix[u - start + ahead + 1] - desk.prefix[u - start - behind]
    for y in range(1, last - first):
        for x in range(right - left):
            desk.rows[y, x] += desk.rows[y - 1, x]
    for v in range(top, bottom):
        for u in range(left, right):
            total = desk.rows[v - first + np.int64(view.arms[3, v, u]), u - left]
            above = v - first - np.int64(view.arms[2, v, u]) - 1
            if above >= 0:
                total -= desk.rows[above, u - left]
            desk.cost[v - top, u - left] = total * view.inverse_size[v, u]


@kernel
def _bend(  # type: ignore[no-untyped-def]
    a, b, c, first, last, start, stop, height, width, other, bent
):
    """Read the other view along the plane, with a margin for the census; both views are continued at their borders."""
    most = np.float32(other.shape[1] - 1)
    for v in range(first - RADIUS, last + RADIUS):
        y = min(max(v, 0), height - 1)
        here = b * np.float32(y) + c
        for u in range(start - RADIUS, stop + RADIUS):
            x = np.float32(min(max(u, 0), width - 1))
            at = min(max((x - (here + a * x)) * np.float32(QUARTERS), np.float32(0)), most)
            i = int(at)
            value = np.float32(other[y, i])
            if i + 1 < other.shape[1]:
                value += (at - np.float32(i)) * np.float32(other[y, i + 1] - other[y, i])
            bent[v - first + RADIUS, u - start + RADIUS] = np.int16(value)


@kernel
def _compare(y, v, start, stop, bent, differences, softness, sign, differing):  # type: ignore[no-untyped-def]
    """Sum, for a row, what differs between the views: `sign` for another sign, and the cut difference."""
    n = stop - start
    for i in range(n):
        differing[i] = 0
    centre = bent[y + RADIUS, RADIUS : RADIUS + n]
    plane = 0
    for dv in range(-RADIUS, RADIUS + 1):
        for du in range(-RADIUS, RADIUS + 1):
            if dv == 0 and du == 0:
                continue
            neighbour = bent[y + RADIUS + dv, RADIUS + du : RADIUS + du + n]
            mine = differences[plane, v, start:stop]
            for i in range(n):
                brighter = np.int16(neighbour[i] - centre[i])
                apart = min(np.int16(abs(np.int16(brighter - mine[i]))), softness)
                other_sign = np.int16((brighter > 0) != (mine[i] > 0))
                differing[i] = np.int16(differing[i] + apart + sign * other_sign)
            plane += 1


@kernel
def _prefix(a, here, start, stop, width, low, high, most, differing, prefix):  # type: ignore[no-untyped-def]
    """Running sums of the pixels' costs along a row."""
    total = np.float32(0)
    prefix[0] = total
    half = np.float32(0.5)
    for u in range(start, stop):
        d = here + a * np.float32(u)
        x = np.float32(u) - d
        if d < low - half or d > high + half:
            total += np.float32(FORBIDDEN)
        elif x < -half or x > np.float32(width) - half:
            total += np.float32(OUTSIDE)
        else:
            total += min(np.float32(differing[u - start]), most) * (np.float32(2) / most)
        prefix[u - start + 1] = total
