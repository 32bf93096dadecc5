"""The data cost of a plane: local differences after the other view is bent along the plane, averaged over crosses.

A window that stays parallel to the image plane compares the wrong pixels where a surface is steep: on a floor that
gains a pixel of disparity a row nothing matches. So the window is slanted with the plane: the other view is read at
``u - d(u, v)``, between the pixels, and only then are neighbours compared. The cost of a plane at a pixel depends on
nothing else, in particular not on the tile in which it is asked for.

A pixel's cost compares its differences from 24 neighbours with those in the other view. Half of it is the census, that
is whether they have the same sign, which gain and offset leave alone; half is by how much they differ, cut at a part of
the image's contrast, which tells more where texture is weak.

To that comes how far the plane lies from the start, where both views agree about it: the start sees colours, and every
pixel by itself, so it knows edges that gray and crosses do not, and holds what is blank.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy import uint64 as index  # unsigned indices spare the test for negative ones
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.match.planes.census import RADIUS, Pattern
from uw_recon_ros.match.planes.cross_support import REACH, Arms
from uw_recon_ros.match.planes.gray import CONTRAST, Gray
from uw_recon_ros.types import FloatImage, Mask

BLOCK = 64  #: pixels compared at once
QUARTERS = 4  #: samples a pixel in `CostData.other`
SOFTNESS, SOFTNESS_NOISY = 0.4, 1.2  #: part of the contrast at which the difference between differences is cut
SIGNS, SIGNS_NOISY = 0.5, 0.0  #: weight of the signs
WORST = 2.0  #: cost of what differs as much as by chance
OUTSIDE = 1.0  #: least cost of a match outside the other view; no less than a usual match
OUTSIDE_SEEN = 1.8  #: the same where the start found the pixel in both views
FORBIDDEN = 4.0  #: cost of a disparity outside the limits
NEAR_START, FAR_FROM_START = 0.5, 1.5  #: px; nearer costs nothing, farther no more


class CostData(NamedTuple):
    """All that the costs of planes need.

    Parameters
    ----------
    gray : (H + 2 `RADIUS`, W + 2 `RADIUS` + `BLOCK`) int16
        This view, continued beyond its borders; see `extend_borders`.
    softness, sign : int16
        Where the difference between differences is cut, and what another sign costs.
    most : int16
        Where a pixel's cost is cut.
    outside : (H, W) int16
        A pixel's cost outside the other view.
    pattern : (24, 2) int64
        The neighbours: rows, columns.
    other : (H, 4 W - 3) int16
        The other view, four samples a pixel.
    arms : (4, H, W) uint8
    inverse_size : (H, W) float32
        Of `cross_support`.
    low, high : float32
        Limits of the disparity, px.
    start, trust : (H, W) float32
        The start's disparity, px, and what a plane costs that lies far from it; of `trust_in`.
    """

    gray: Gray
    softness: np.int16
    sign: np.int16
    most: np.int16
    outside: NDArray[np.int16]
    pattern: Pattern
    other: NDArray[np.int16]
    arms: Arms
    inverse_size: FloatImage
    low: np.float32
    high: np.float32
    start: FloatImage
    trust: FloatImage


def extend_borders(gray: Gray) -> Gray:
    """Continue an image beyond its borders: by the window, and to the right by what rounding up to blocks may read."""
    return np.ascontiguousarray(np.pad(gray, ((RADIUS, RADIUS), (RADIUS, RADIUS + BLOCK)), mode="edge"))


def cost_weights(noise: float) -> tuple[int, int]:
    """`CostData.softness` and `CostData.sign` for images as noisy as `gray.gray_pair` says.

    The more noise, the less the sign of a difference tells, and the more its size.
    """
    softness = round(CONTRAST * (SOFTNESS + (SOFTNESS_NOISY - SOFTNESS) * noise))
    return softness, round(softness * 2 * (SIGNS + (SIGNS_NOISY - SIGNS) * noise))


def trust_in(usable: Mask, noise: float, most: float) -> FloatImage:
    """`CostData.trust`, (H, W), at most `most` where the start is `usable`; none in images that are noisy throughout.

    `noise` is that of `gray.gray_pair`.
    """
    return np.asarray(usable * np.float32(most * (1 - noise)), np.float32)


class Workspace(NamedTuple):
    """Working memory of one thread."""

    bent: NDArray[np.int16]
    apart: NDArray[np.int16]
    differing: NDArray[np.int16]
    prefix: NDArray[np.int32]
    sums: NDArray[np.int32]
    cost: FloatImage


def make_workspace(side: int) -> Workspace:
    """Memory for regions of at most `side` x `side` pixels."""
    wide = side + 2 * REACH
    blocks = -(-wide // BLOCK) * BLOCK
    return Workspace(
        np.zeros((wide + 2 * RADIUS, blocks + 2 * RADIUS), np.int16),
        np.zeros((wide + 2 * RADIUS, blocks + 2 * RADIUS), np.int16),
        np.zeros(blocks, np.int16),
        np.zeros(wide + 1, np.int32),
        np.zeros((wide + 1, side), np.int32),
        np.zeros((side, side), np.float32),
    )


@kernel(allocates=False)
def plane_cost(
    a: float,
    b: float,
    c: float,
    top: int,
    bottom: int,
    left: int,
    right: int,
    view: CostData,
    work: Workspace,
) -> None:
    """Write the cost of disparity ``a u + b v + c`` for the pixels of a region into ``work.cost``."""
    height, width = view.inverse_size.shape
    first, last = max(0, top - REACH), min(height, bottom + REACH)
    start, stop = max(0, left - REACH), min(width, right + REACH)
    _bend(a, b, c, first, last, start, stop, height, width, view.other, work.bent)
    _subtract(first, last, start, stop, view.gray, work.bent, work.apart)
    arms, sums = view.arms, work.sums
    for v in range(first, last):
        _compare(v - first, v, start, stop, view, work)
        _prefix(a, b * np.float32(v) + c, v, start, stop, width, view, work.differing, work.prefix)
        behind, ahead = arms[0, v, left:right], arms[1, v, left:right]
        before, here = sums[v - first, : right - left], sums[v - first + 1, : right - left]
        for x in range(right - left):
            j, u = index(x), index(x + left - start)
            here[j] = before[j] + work.prefix[u + index(ahead[j]) + index(1)] - work.prefix[u - index(behind[j])]
    scale = np.float32(WORST) / np.float32(view.most)
    for v in range(top, bottom):
        above, below, inverse = arms[2, v, left:right], arms[3, v, left:right], view.inverse_size[v, left:right]
        cost = work.cost[v - top, : right - left]
        for x in range(right - left):
            j, y = index(x), index(v - first)
            total = sums[y + index(below[j]) + index(1), j] - sums[y - index(above[j]), j]
            cost[j] = np.float32(total) * (scale * inverse[j])
        _add_distance(a, b * np.float32(v) + c, v, left, right, view, cost)


@kernel(allocates=False)
def _add_distance(a, here, v, left, right, view, cost):  # type: ignore[no-untyped-def]
    """Add what it costs to be far from the start."""
    start, trust = view.start[v, left:right], view.trust[v, left:right]
    near, most = np.float32(NEAR_START), np.float32(FAR_FROM_START - NEAR_START)
    for x in range(right - left):
        j = index(x)
        apart = np.float32(abs(here + a * np.float32(left + x) - start[j]) - near)
        cost[j] += trust[j] * (min(max(apart, np.float32(0)), most) / most)


@kernel(allocates=False)
def _bend(  # type: ignore[no-untyped-def]
    a, b, c, first, last, start, stop, height, width, other, bent
):
    """Read the other view along the plane, with a margin for the window; both views are continued at their borders.

    Places are counted in fixed point, with 32 binary digits: what a pixel reads does not depend on the region.
    """
    one = np.float64(QUARTERS * (1 << 32))
    slope, most = int((1.0 - np.float64(a)) * one), (other.shape[1] - 1) << 32
    n = stop - start + 2 * RADIUS
    for v in range(first - RADIUS, last + RADIUS):
        y = min(max(v, 0), height - 1)
        origin = int((np.float64(b) * y + np.float64(c)) * -one)
        source, row = other[y], bent[v - first + RADIUS]
        at, end = origin + slope * (start - RADIUS), origin + slope * (stop + RADIUS - 1)
        if start >= RADIUS and stop + RADIUS <= width and min(at, end) >= 0 and max(at, end) < most:
            for i in range(n):
                row[index(i)] = _between(source, at)
                at += slope
            continue
        for i in range(n):
            x = min(max(start - RADIUS + i, 0), width - 1)
            at = min(max(origin + slope * x, 0), most)
            row[index(i)] = _between(source, at) if at < most else source[source.size - 1]


@kernel(allocates=False, inline=True)
def _between(source: NDArray[np.int16], at: int) -> np.int16:
    """Linear interpolation at a place in fixed point."""
    i = index(at) >> index(32)
    part = np.int32((index(at) >> index(17)) & index(0x7FFF))
    here, beyond = np.int32(source[i]), np.int32(source[i + index(1)])
    value: np.int16 = np.int16(here + (((beyond - here) * part) >> np.int32(15)))
    return value


@kernel(allocates=False)
def _subtract(first, last, start, stop, gray, bent, apart):  # type: ignore[no-untyped-def]
    """By how much the bent view is brighter than this one: differences of this are differences of differences."""
    n = stop - start + 2 * RADIUS
    for y in range(last - first + 2 * RADIUS):
        theirs, mine, row = bent[y, :n], gray[first + y, start : start + n], apart[y, :n]
        for i in range(n):
            j = index(i)
            row[j] = np.int16(theirs[j] - mine[j])


@kernel(allocates=False)
def _compare(y, v, start, stop, view, work):  # type: ignore[no-untyped-def]
    """Sum, for a row, what differs between the views: `sign` for another sign, and the cut difference.

    In blocks of a fixed size, which compilers turn into a few wide instructions; what lies beyond `stop` is not used.
    """
    softness, sign = view.softness, view.sign
    for block in range(0, stop - start, BLOCK):
        total = work.differing[block : block + BLOCK]
        for i in range(BLOCK):
            total[i] = 0
        x, u = block + RADIUS, start + block + RADIUS
        apart, theirs = work.apart[y + RADIUS, x : x + BLOCK], work.bent[y + RADIUS, x : x + BLOCK]
        mine = view.gray[v + RADIUS, u : u + BLOCK]
        for n in range(view.pattern.shape[0]):
            dv, du = view.pattern[n, 0], view.pattern[n, 1]
            row, p, q = y + RADIUS + dv, x + du, u + du
            next_apart, next_theirs = work.apart[row, p : p + BLOCK], work.bent[row, p : p + BLOCK]
            next_mine = view.gray[v + RADIUS + dv, q : q + BLOCK]
            if sign == 0:  # in noise; half of the time is theirs
                for i in range(BLOCK):
                    size = min(np.int16(abs(np.int16(next_apart[i] - apart[i]))), softness)
                    total[i] = np.int16(total[i] + size)
                continue
            for i in range(BLOCK):
                size = min(np.int16(abs(np.int16(next_apart[i] - apart[i]))), softness)
                other_sign = (next_theirs[i] > theirs[i]) != (next_mine[i] > mine[i])
                total[i] = np.int16(total[i] + np.int16(size + (sign if other_sign else np.int16(0))))


@kernel(allocates=False)
def _prefix(a, here, v, start, stop, width, view, differing, prefix):  # type: ignore[no-untyped-def]
    """Running sums of the pixels' costs along a row."""
    half, most = np.float32(0.5), np.int32(view.most)
    low, high, edge = view.low - half, view.high + half, np.float32(width) - half
    u, end = np.float32(start), np.float32(stop - 1)
    least, greatest = min(here + a * u, here + a * end), max(here + a * u, here + a * end)
    inside = (
        min(u - here - a * u, end - here - a * end) >= -half and max(u - here - a * u, end - here - a * end) <= edge
    )
    total = np.int32(0)
    prefix[index(0)] = total
    if least >= low and greatest <= high and inside:
        for i in range(stop - start):
            total = np.int32(total + min(np.int32(differing[index(i)]), most))
            prefix[index(i) + index(1)] = total
        return
    outside, forbidden = view.outside[v], np.int32(most * FORBIDDEN / WORST)
    for i in range(stop - start):
        u = np.float32(start + i)
        d = here + a * u
        cost = min(np.int32(differing[index(i)]), most)
        if d < low or d > high:
            cost = forbidden
        elif u - d < -half or u - d > edge:
            cost = np.int32(outside[start + i])
        total = np.int32(total + cost)
        prefix[index(i) + index(1)] = total
