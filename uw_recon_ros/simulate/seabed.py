"""The seabed, a uniform cubic B-spline surface z(x, y): its height, its slopes, and where a ray meets it."""

from __future__ import annotations

import math

from uw_recon_ros.jit import kernel
from uw_recon_ros.simulate.scene import BLOCK
from uw_recon_ros.types import Matrix

_NEWTON = 3e-4  # m; from where Newton's method takes over
_CLOSE = 1e-7  # m; where a march ends

Hit = tuple[float, float, float, float]  # distance along the ray (infinity: none) and outward unit normal


@kernel(inline=True)
def _place(heights: Matrix, grid: Matrix, x: float, y: float) -> tuple[int, int, float, float]:
    """First coefficient that counts at x, y, and where between coefficients that is; the rim goes on outside."""
    u = min(max((x - grid[0]) / grid[2], 1.0), heights.shape[1] - 2.001)
    v = min(max((y - grid[1]) / grid[2], 1.0), heights.shape[0] - 2.001)
    i, j = int(u), int(v)
    return i - 1, j - 1, u - i, v - j


@kernel
def seabed_height(heights: Matrix, grid: Matrix, x: float, y: float) -> float:
    """Height of the B-spline surface, m."""
    i, j, u, v = _place(heights, grid, x, y)
    a, b, c, d = _weights(u)
    p, q, r, s = _weights(v)
    h = heights
    height: float = (
        p * (a * h[j, i] + b * h[j, i + 1] + c * h[j, i + 2] + d * h[j, i + 3])
        + q * (a * h[j + 1, i] + b * h[j + 1, i + 1] + c * h[j + 1, i + 2] + d * h[j + 1, i + 3])
        + r * (a * h[j + 2, i] + b * h[j + 2, i + 1] + c * h[j + 2, i + 2] + d * h[j + 2, i + 3])
        + s * (a * h[j + 3, i] + b * h[j + 3, i + 1] + c * h[j + 3, i + 2] + d * h[j + 3, i + 3])
    )
    return height


@kernel
def seabed_slopes(heights: Matrix, grid: Matrix, x: float, y: float) -> tuple[float, float]:
    """Its slopes in x and y."""
    i, j, u, v = _place(heights, grid, x, y)
    columns, rows = _weights(u), _weights(v)
    column_slopes, row_slopes = _slope_weights(u), _slope_weights(v)
    slope_x = slope_y = 0.0
    for row in range(4):
        for column in range(4):
            slope_x += rows[row] * column_slopes[column] * heights[j + row, i + column]
            slope_y += row_slopes[row] * columns[column] * heights[j + row, i + column]
    return slope_x / grid[2], slope_y / grid[2]


@kernel(inline=True)
def _weights(t: float) -> tuple[float, float, float, float]:
    """Uniform cubic B-spline basis."""
    s = 1.0 - t
    return (
        s * s * s / 6.0,
        (t * t * (3.0 * t - 6.0) + 4.0) / 6.0,
        (s * s * (3.0 * s - 6.0) + 4.0) / 6.0,
        t * t * t / 6.0,
    )


@kernel(inline=True)
def _slope_weights(t: float) -> tuple[float, float, float, float]:
    """Its derivative."""
    s = 1.0 - t
    return -0.5 * s * s, 1.5 * t * t - 2.0 * t, 2.0 * s - 1.5 * s * s, 0.5 * t * t


@kernel
def hit_seabed(
    heights: Matrix, grid: Matrix, blocks: Matrix,
    ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, start: float, limit: float,
) -> Hit:  # fmt: skip
    """March in steps that the slope's upper bound around each block makes safe, then Newton's method."""
    t = start
    if oz > grid[3] and dz < 0.0:
        t = max(t, (grid[3] - oz) / dz)
    elif oz > grid[3]:
        return math.inf, 0.0, 0.0, 0.0
    flat = math.sqrt(dx * dx + dy * dy)
    stride = BLOCK * grid[2]  # no step leaves the ring of blocks that the bounds are for
    fall = min(0.0, dz * stride)
    while t < limit:
        x, y, z = ox + t * dx, oy + t * dy, oz + t * dz
        if z > grid[3] and dz >= 0.0:
            break
        column = min(max(int((x - grid[0]) / stride), 0), blocks.shape[1] - 1)
        row = min(max(int((y - grid[1]) / stride), 0), blocks.shape[0] - 1)
        if z + fall > blocks[row, column, 1]:
            t += stride
            continue
        gap = z - seabed_height(heights, grid, x, y)
        if gap < _NEWTON:
            found = t if gap < _CLOSE else _newton(heights, grid, ox, oy, oz, dx, dy, dz, t)
            if found >= t:
                sx, sy = seabed_slopes(heights, grid, ox + found * dx, oy + found * dy)
                norm = math.sqrt(1.0 + sx * sx + sy * sy)
                return found, -sx / norm, -sy / norm, 1.0 / norm
        t += min(stride, gap / (abs(dz) + blocks[row, column, 0] * flat))
    return math.inf, 0.0, 0.0, 0.0


@kernel
def _newton(
    heights: Matrix, grid: Matrix, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, t: float
) -> float:
    """Where a ray that is closer than `_NEWTON` meets the seabed; -1 where it only grazes it or does so later."""
    sx, sy = seabed_slopes(heights, grid, ox + t * dx, oy + t * dy)
    speed = dz - sx * dx - sy * dy
    found = t
    for _ in range(8):
        step = (oz + found * dz - seabed_height(heights, grid, ox + found * dx, oy + found * dy)) / speed
        found -= step
        if abs(found - t) > 0.03:
            return -1.0
        if abs(step) < _CLOSE:
            return found
    return -1.0
