"""Where rays meet a scene: exact to well below a pixel, occlusion included.

Every kernel takes the scene as its arrays (`heights`, `grid`, `blocks`, `objects` of `Scene`), rays as an origin and a
unit direction in world coordinates, and gives distances along the ray in m; infinity where nothing is met.
"""

from __future__ import annotations

import math

import numpy as np

from uw_recon_ros.jit import kernel
from uw_recon_ros.simulate.scene import AMPHORA, BLOCK, BOX, CYLINDER, SPHERE
from uw_recon_ros.types import Matrix

FAR_M = 25.0
_NEWTON = 3e-4  # m; from where Newton's method takes over
_CLOSE = 1e-7  # m; where a march ends
_NEAREST = 1e-4  # m; a ray does not meet the surface it starts from

Hit = tuple[float, float, float, float]  # distance and outward unit normal


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


@kernel
def hit_sphere(ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, radius: float) -> Hit:
    """A sphere about the origin."""
    b = ox * dx + oy * dy + oz * dz
    c = ox * ox + oy * oy + oz * oz - radius * radius
    inside = b * b - c
    if inside <= 0.0:
        return math.inf, 0.0, 0.0, 0.0
    t = -b - math.sqrt(inside)
    if t < _NEAREST:
        return math.inf, 0.0, 0.0, 0.0
    return t, (ox + t * dx) / radius, (oy + t * dy) / radius, (oz + t * dz) / radius


@kernel
def hit_box(ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, a: float, b: float, c: float) -> Hit:
    """A box about the origin with half sizes a, b, c."""
    enter, leave, side = -math.inf, math.inf, 0
    for axis in range(3):
        origin = ox if axis == 0 else (oy if axis == 1 else oz)
        slope = dx if axis == 0 else (dy if axis == 1 else dz)
        half = a if axis == 0 else (b if axis == 1 else c)
        if slope == 0.0:
            if abs(origin) > half:
                return math.inf, 0.0, 0.0, 0.0
            continue
        first, second = (-half - origin) / slope, (half - origin) / slope
        if first > second:
            first, second = second, first
        if first > enter:
            enter, side = first, axis
        leave = min(leave, second)
    if enter > leave or enter < _NEAREST:
        return math.inf, 0.0, 0.0, 0.0
    if side == 0:
        return enter, -math.copysign(1.0, dx), 0.0, 0.0
    if side == 1:
        return enter, 0.0, -math.copysign(1.0, dy), 0.0
    return enter, 0.0, 0.0, -math.copysign(1.0, dz)


@kernel
def hit_cylinder(ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, radius: float, half: float) -> Hit:
    """A closed cylinder about the z axis."""
    a = dx * dx + dy * dy
    b = ox * dx + oy * dy
    inside = b * b - a * (ox * ox + oy * oy - radius * radius)
    if a > 0.0 and inside > 0.0:
        t = (-b - math.sqrt(inside)) / a
        if t >= _NEAREST and abs(oz + t * dz) <= half:
            return t, (ox + t * dx) / radius, (oy + t * dy) / radius, 0.0
    if dz != 0.0:
        t = (-math.copysign(half, dz) - oz) / dz
        x, y = ox + t * dx, oy + t * dy
        if t >= _NEAREST and x * x + y * y <= radius * radius:
            return t, 0.0, 0.0, -math.copysign(1.0, dz)
    return math.inf, 0.0, 0.0, 0.0


@kernel
def amphora_distance(x: float, y: float, z: float, tall: float, belly: float) -> float:
    """Lower bound of the distance to an amphora standing along z, from -tall/2 to tall/2; negative inside."""
    s = min(max(z / tall + 0.5, 0.0), 1.0)  # 0 at the foot, 1 at the lip
    bulge = math.sin(math.pi * min(s / 0.80, 1.0)) ** 0.8 if s < 0.80 else 0.0
    neck = 0.36 / (1.0 + math.exp(-(s - 0.62) * 26.0))
    lip = 0.14 * math.exp(-(((s - 0.97) / 0.022) ** 2))
    radius = belly * (0.10 + max(bulge * 0.90, neck) + lip)
    ring = abs(z) - 0.5 * tall
    body = max((math.sqrt(x * x + y * y) - radius) * 0.55, ring)
    handle = math.inf
    for side in (-1.0, 1.0):  # a torus in the plane y = 0
        hx, hz = x - side * belly * 0.48, z - 0.30 * tall
        across = math.sqrt(hx * hx + hz * hz * 0.55) - 0.115 * tall
        handle = min(handle, (math.sqrt(across * across + y * y) - 0.014) * 0.7)
    return min(body, handle)


@kernel
def hit_amphora(
    ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, tall: float, belly: float, limit: float
) -> Hit:
    """Sphere tracing, with the distance's lower bound for a step."""
    b = ox * dx + oy * dy + oz * dz
    reach = 0.62 * tall
    apart = ox * ox + oy * oy + oz * oz - b * b
    if apart > reach * reach:
        return math.inf, 0.0, 0.0, 0.0
    half = math.sqrt(reach * reach - apart)
    t, end = max(_NEAREST, -b - half), min(limit, -b + half)
    while t < end:
        gap = amphora_distance(ox + t * dx, oy + t * dy, oz + t * dz, tall, belly)
        if gap < _CLOSE:
            nx, ny, nz = _amphora_normal(ox + t * dx, oy + t * dy, oz + t * dz, tall, belly)
            return t, nx, ny, nz
        t += gap
    return math.inf, 0.0, 0.0, 0.0


@kernel
def _amphora_normal(x: float, y: float, z: float, tall: float, belly: float) -> tuple[float, float, float]:
    e = 1e-5
    nx = amphora_distance(x + e, y, z, tall, belly) - amphora_distance(x - e, y, z, tall, belly)
    ny = amphora_distance(x, y + e, z, tall, belly) - amphora_distance(x, y - e, z, tall, belly)
    nz = amphora_distance(x, y, z + e, tall, belly) - amphora_distance(x, y, z - e, tall, belly)
    norm = math.sqrt(nx * nx + ny * ny + nz * nz) + 1e-30
    return nx / norm, ny / norm, nz / norm


@kernel
def _hit_thing(thing: Matrix, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, limit: float) -> Hit:
    """In the thing's own coordinates."""
    if thing[0] == SPHERE:
        return hit_sphere(ox, oy, oz, dx, dy, dz, thing[13])
    if thing[0] == BOX:
        return hit_box(ox, oy, oz, dx, dy, dz, thing[13], thing[14], thing[15])
    if thing[0] == CYLINDER:
        return hit_cylinder(ox, oy, oz, dx, dy, dz, thing[13], thing[14])
    if thing[0] == AMPHORA:
        return hit_amphora(ox, oy, oz, dx, dy, dz, thing[13], thing[14], limit)
    return math.inf, 0.0, 0.0, 0.0


@kernel
def nearest_thing(
    objects: Matrix, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, limit: float
) -> tuple[float, int, float, float, float]:
    """Distance, index (-2 nothing) and world normal of the thing a ray meets first."""
    best, which = limit, -2
    nx = ny = nz = 0.0
    for index in range(objects.shape[0]):
        o = objects[index]
        px, py, pz = ox - o[1], oy - o[2], oz - o[3]
        t, a, b, c = _hit_thing(
            o,
            o[4] * px + o[5] * py + o[6] * pz, o[7] * px + o[8] * py + o[9] * pz, o[10] * px + o[11] * py + o[12] * pz,
            o[4] * dx + o[5] * dy + o[6] * dz, o[7] * dx + o[8] * dy + o[9] * dz, o[10] * dx + o[11] * dy + o[12] * dz,
            best,
        )  # fmt: skip
        if t < best:
            best, which = t, index
            nx = o[4] * a + o[7] * b + o[10] * c
            ny = o[5] * a + o[8] * b + o[11] * c
            nz = o[6] * a + o[9] * b + o[12] * c
    return best, which, nx, ny, nz


@kernel
def nearest_hit(
    heights: Matrix, grid: Matrix, blocks: Matrix, objects: Matrix,
    ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, limit: float,
) -> tuple[float, int, float, float, float]:  # fmt: skip
    """Distance, index of the thing (-1 the seabed, -2 nothing) and world normal of what a ray meets first."""
    best, which, nx, ny, nz = nearest_thing(objects, ox, oy, oz, dx, dy, dz, limit)
    t, a, b, c = hit_seabed(heights, grid, blocks, ox, oy, oz, dx, dy, dz, _NEAREST, best)
    if t < best:
        return t, -1, a, b, c
    if which == -2:
        return math.inf, which, 0.0, 0.0, 0.0
    return best, which, nx, ny, nz


@kernel
def is_blocked(
    heights: Matrix, grid: Matrix, blocks: Matrix, objects: Matrix,
    ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, limit: float,
) -> bool:  # fmt: skip
    """Whether anything is met before the limit; the seabed's own bumps count from 2 cm on."""
    if hit_seabed(heights, grid, blocks, ox, oy, oz, dx, dy, dz, 0.02, limit)[0] < limit:
        return True
    return nearest_thing(objects, ox, oy, oz, dx, dy, dz, limit)[1] >= 0


@kernel
def cast(
    heights: Matrix, grid: Matrix, blocks: Matrix, objects: Matrix, origin: Matrix, directions: Matrix, limits: Matrix
) -> Matrix:
    """Distance along each ray.

    Parameters
    ----------
    origin : (3,) float64
        m.
    directions : (N, 3) float64
        Unit vectors.
    limits : (N,) float64
        How far to look, m.

    Returns
    -------
    (N,) float64
        m; infinity where nothing is met before the limit.
    """
    ranges = np.empty(directions.shape[0])
    for i in range(directions.shape[0]):
        ranges[i] = nearest_hit(
            heights, grid, blocks, objects, origin[0], origin[1], origin[2],
            directions[i, 0], directions[i, 1], directions[i, 2], limits[i],
        )[0]  # fmt: skip
    return ranges
