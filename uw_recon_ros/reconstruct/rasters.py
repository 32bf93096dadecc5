"""Triangles over the pixel grid: the kernels that look at every pixel under a mesh.

A triangle covers the pixels whose centres lie in it or on its border. All tests are in exact integer arithmetic.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.types import FloatImage, Mask

Ints = NDArray[np.int32]


@kernel(inline=True)
def _span(u: Ints, v: Ints, row: int, low: int, high: int) -> tuple[int, int]:
    """First and last covered column of a `row` among those of the triangle (u, v), cut to [low, high]."""
    area = (u[1] - u[0]) * (v[2] - v[0]) - (u[2] - u[0]) * (v[1] - v[0])
    sign = 1 if area > 0 else -1
    for i in range(3):
        j = i + 1 if i < 2 else 0
        du, dv = sign * (u[j] - u[i]), sign * (v[j] - v[i])
        # inside: du (row - v_i) - dv (column - u_i) >= 0
        limit = du * (row - v[i]) + dv * u[i]
        if dv > 0:
            high = min(high, limit // dv)
        elif dv < 0:
            low = max(low, -(limit // -dv))
    return low, high


@kernel(inline=True)
def _corners(vertices: Ints, triangle: Ints, u: Ints, v: Ints) -> float:
    """Fill in the corners; return twice the signed area, px^2."""
    for i in range(3):
        u[i], v[i] = vertices[triangle[i], 0], vertices[triangle[i], 1]
    return float((u[1] - u[0]) * (v[2] - v[0]) - (u[2] - u[0]) * (v[1] - v[0]))


@kernel
def misfit(
    level: FloatImage,
    vertices: Ints,
    triangles: Ints,
    tolerance: float,
    cap: float,
    worst: Ints,
    total: FloatImage,
) -> None:
    """How far `level` departs from the plane of each triangle.

    Parameters
    ----------
    level : (H, W) float32
        px; NaN: no matter what.
    vertices : (N, 2) int32
        Pixels (u, v).
    triangles : (M, 3) int32
    tolerance : float
        Departures up to this are none, px.
    cap : float
        Departures over this many tolerances are counted as this.
    worst : (M, 2) int32
        Out: the pixel that departs most.
    total : (M,) float32
        Out: sum of the capped departures in tolerances; 0 where all are within.
    """
    u, v = np.empty(3, np.int32), np.empty(3, np.int32)
    for m in range(len(triangles)):
        total[m] = np.float32(0.0)
        area = _corners(vertices, triangles[m], u, v)
        if area == 0.0:
            continue
        base = level[v[0], u[0]]
        rise1, rise2 = level[v[1], u[1]] - base, level[v[2], u[2]] - base
        slope_u = (rise1 * (v[2] - v[0]) - rise2 * (v[1] - v[0])) / area
        slope_v = (rise2 * (u[1] - u[0]) - rise1 * (u[2] - u[0])) / area
        largest, sum_ = tolerance, 0.0
        for row in range(v.min(), v.max() + 1):
            low, high = _span(u, v, row, u.min(), u.max())
            for column in range(low, high + 1):
                plane = base + slope_u * (column - u[0]) + slope_v * (row - v[0])
                departure = abs(level[row, column] - plane)
                if departure > tolerance:  # never for NaN
                    sum_ += min(departure / tolerance, cap)
                if departure > largest:
                    largest = departure
                    worst[m, 0], worst[m, 1] = column, row
        total[m] = sum_


@kernel
def broken_triangles(cut_right: Mask, cut_below: Mask, vertices: Ints, triangles: Ints, broken: Mask) -> None:
    """Mark triangles that cover, or whose sides cross, a gap or a jump between neighbouring pixels.

    Parameters
    ----------
    cut_right, cut_below : (H, W) bool
        Whether a pixel and its right, its lower neighbour do not belong together.
    vertices : (N, 2) int32
    triangles : (M, 3) int32
    broken : (M,) bool
        Out.
    """
    u, v = np.empty(3, np.int32), np.empty(3, np.int32)
    for m in range(len(triangles)):
        broken[m] = _corners(vertices, triangles[m], u, v) == 0.0 or _covers_cut(cut_right, cut_below, u, v)
        for i in range(3):
            j = i + 1 if i < 2 else 0
            broken[m] = broken[m] or not _connected(cut_right, cut_below, u[i], v[i], u[j], v[j])


@kernel
def _covers_cut(cut_right: Mask, cut_below: Mask, u: Ints, v: Ints) -> bool:
    """Whether two neighbouring pixels that a triangle covers do not belong together."""
    low_below, high_below = 1, 0
    for row in range(v.max(), v.min() - 1, -1):
        low, high = _span(u, v, row, u.min(), u.max())
        for column in range(low, high + 1):
            if column < high and cut_right[row, column]:
                return True
            if low_below <= column <= high_below and cut_below[row, column]:
                return True
        low_below, high_below = low, high
    return False


@kernel
def _connected(cut_right: Mask, cut_below: Mask, u0: int, v0: int, u1: int, v1: int) -> bool:
    """Whether a chain of neighbours that belong together leads from one end of a segment to the other.

    The chain may use the pixels within one pixel of the segment. ``row`` walks below the segment column by column (or,
    where the segment is steep, row by row); three bits say which of row - 1, row, row + 1 are reached.
    """
    width = cut_right.shape[1]
    steep = abs(v1 - v0) > abs(u1 - u0)
    a0, b0, a1, b1 = (v0, u0, v1, u1) if steep else (u0, v0, u1, v1)
    across = cut_right.ravel() if steep else cut_below.ravel()
    along = cut_below.ravel() if steep else cut_right.ravel()
    stride_a, stride_b, size_b = (width, 1, width) if steep else (1, width, cut_right.shape[0])
    length, direction = abs(a1 - a0), 1 if a1 > a0 else -1
    row, reached = b0, 2
    for k in range(length + 1):
        a, previous = a0 + direction * k, row
        row = b0 + ((b1 - b0) * k) // max(length, 1)
        reached = (reached >> (row - previous)) if row >= previous else (reached << (previous - row)) & 7
        exact = ((b1 - b0) * k) % max(length, 1) == 0
        allowed = (7 if exact else 6) & (7 if row > 0 else 6) & (7 if row + 1 < size_b else 3)
        reached &= allowed
        for i in range(3):
            edge = (row - 1 + i) * stride_b + min(a, a - direction) * stride_a
            if k > 0 and reached & (1 << i) and along[edge]:
                reached &= ~(1 << i)
        for i in (0, 1, 0):
            pair = 3 << i
            joined = allowed & pair == pair and not across[(row - 1 + i) * stride_b + a * stride_a]
            if joined and reached & pair:
                reached |= pair
    return reached & 2 != 0
