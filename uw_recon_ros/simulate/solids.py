"""Where a ray, given by an origin and a unit direction in the thing's own coordinates, meets it."""

from __future__ import annotations

import math

from uw_recon_ros.jit import kernel
from uw_recon_ros.simulate.scene import AMPHORA, BOX, CYLINDER, SPHERE
from uw_recon_ros.simulate.seabed import Hit
from uw_recon_ros.types import Matrix

NEAREST_M = 1e-4  # a ray does not meet the surface it starts from
_CLOSE = 1e-7  # m; where a march ends


@kernel
def hit_sphere(ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, radius: float) -> Hit:
    """A sphere about the origin."""
    b = ox * dx + oy * dy + oz * dz
    c = ox * ox + oy * oy + oz * oz - radius * radius
    inside = b * b - c
    if inside <= 0.0:
        return math.inf, 0.0, 0.0, 0.0
    t = -b - math.sqrt(inside)
    if t < NEAREST_M:
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
    if enter > leave or enter < NEAREST_M:
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
        if t >= NEAREST_M and abs(oz + t * dz) <= half:
            return t, (ox + t * dx) / radius, (oy + t * dy) / radius, 0.0
    if dz != 0.0:
        t = (-math.copysign(half, dz) - oz) / dz
        x, y = ox + t * dx, oy + t * dy
        if t >= NEAREST_M and x * x + y * y <= radius * radius:
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
    t, end = max(NEAREST_M, -b - half), min(limit, -b + half)
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
def hit_thing(thing: Matrix, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float, limit: float) -> Hit:
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
