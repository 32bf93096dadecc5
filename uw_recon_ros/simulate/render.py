"""The light that leaves the surfaces towards a camera, before any water: occlusion, shadows, soft outlines."""

from __future__ import annotations

import math

import numpy as np

from uw_recon_ros.jit import kernel
from uw_recon_ros.simulate.material import albedo
from uw_recon_ros.simulate.ray_casting import FAR_M, is_blocked, nearest_hit
from uw_recon_ros.simulate.scene import Scene
from uw_recon_ros.types import Matrix

Ray = tuple[float, float, float]
_SHADOW_OFFSET = 5e-4  # m
_EDGE = 0.02  # relative jump in range that makes an outline
_LINE, _LINE_MEAN = 6, 0.2406  # sharpness of a caustic's lines, and what they are on average
_SUB = 3  # rays a side of an outline's pixel


@kernel
def lamp_irradiance(light: Matrix, channel: int, x: float, y: float, z: float) -> float:
    """Of a surface at a place that faces the lamp: power cone(angle) exp(-c r) / r^2.

    `light` holds the lamp's place (3), direction (3), power, cosine of half its cone, and attenuation c (3, 1/m).
    """
    ax, ay, az = x - light[0], y - light[1], z - light[2]
    r = math.sqrt(ax * ax + ay * ay + az * az) + 1e-9
    cosine = (ax * light[3] + ay * light[4] + az * light[5]) / r
    if cosine <= 0.0:
        return 0.0
    outside = math.acos(min(cosine, 1.0)) / math.acos(light[7])
    cone = math.exp(-(outside**4))
    arriving: float = light[6] * cone * math.exp(-light[8 + channel] * r) / (r * r)
    return arriving


@kernel
def _caustic(x: float, y: float, seconds: float, strength: float) -> float:
    """Daylight through waves, 1 on average: bright lines where three of them cross zero together."""
    waves = (
        math.sin(18.0 * x + 7.0 * y + 2.1 * seconds)
        + math.sin(-9.0 * x + 16.0 * y - 1.7 * seconds + 1.0)
        + math.sin(5.0 * x - 19.0 * y + 2.6 * seconds + 2.0)
    ) / 3.0
    line: float = (1.0 - abs(waves)) ** _LINE
    return 1.0 + strength * (line / _LINE_MEAN - 1.0)


@kernel
def _shade(
    heights: Matrix, grid: Matrix, blocks: Matrix, objects: Matrix, light: Matrix, daylight: Matrix,
    contrast: float, seed: int,
    origin: Matrix, dx: float, dy: float, dz: float, pixel: float,
) -> tuple[float, float, float, float]:  # fmt: skip
    """Range and radiance along one ray."""
    t, which, nx, ny, nz = nearest_hit(
        heights, grid, blocks, objects, origin[0], origin[1], origin[2], dx, dy, dz, FAR_M
    )
    if which == -2:
        return math.inf, 0.0, 0.0, 0.0
    x, y, z = origin[0] + t * dx, origin[1] + t * dy, origin[2] + t * dz
    slant = max(-(nx * dx + ny * dy + nz * dz), 0.15)
    footprint = pixel * t / math.sqrt(slant)
    if which == -1:
        r, g, b = albedo(int(grid[4]), x, y, z, footprint, contrast, seed)
    else:
        o = objects[which]
        px, py, pz = x - o[1], y - o[2], z - o[3]
        r, g, b = albedo(
            int(o[16]), o[4] * px + o[5] * py + o[6] * pz, o[7] * px + o[8] * py + o[9] * pz,
            o[10] * px + o[11] * py + o[12] * pz, footprint, contrast, seed + 1000 * (which + 1),
        )  # fmt: skip
    lit = _facing_lamp(heights, grid, blocks, objects, light, x, y, z, nx, ny, nz)
    sky = 0.6 + 0.4 * nz
    if daylight[3] > 0.0:
        sky *= _caustic(x, y, daylight[4], daylight[3])
    er = daylight[0] * sky + (lit * lamp_irradiance(light, 0, x, y, z) if lit > 0.0 else 0.0)
    eg = daylight[1] * sky + (lit * lamp_irradiance(light, 1, x, y, z) if lit > 0.0 else 0.0)
    eb = daylight[2] * sky + (lit * lamp_irradiance(light, 2, x, y, z) if lit > 0.0 else 0.0)
    return t, r * er, g * eg, b * eb


@kernel
def _facing_lamp(
    heights: Matrix, grid: Matrix, blocks: Matrix, objects: Matrix, light: Matrix,
    x: float, y: float, z: float, nx: float, ny: float, nz: float,
) -> float:  # fmt: skip
    """Cosine of the light's angle of incidence; 0 in the shadow."""
    lx, ly, lz = light[0] - x, light[1] - y, light[2] - z
    r = math.sqrt(lx * lx + ly * ly + lz * lz)
    cosine = (nx * lx + ny * ly + nz * lz) / r
    if cosine <= 0.0 or light[6] <= 0.0:
        return 0.0
    e = _SHADOW_OFFSET
    blocked = is_blocked(
        heights, grid, blocks, objects, x + e * nx, y + e * ny, z + e * nz, lx / r, ly / r, lz / r, r - e
    )
    return 0.0 if blocked else cosine


@kernel
def shade_all(
    heights: Matrix, grid: Matrix, blocks: Matrix, objects: Matrix, light: Matrix, daylight: Matrix,
    contrast: float, seed: int,
    origin: Matrix, directions: Matrix, pixel: float, ranges: Matrix, radiance: Matrix,
) -> None:  # fmt: skip
    """Fill `ranges` (H, W) and `radiance` (H, W, 3) from one ray a pixel along `directions` (H, W, 3)."""
    for v in range(directions.shape[0]):
        for u in range(directions.shape[1]):
            ranges[v, u], radiance[v, u, 0], radiance[v, u, 1], radiance[v, u, 2] = _shade(
                heights, grid, blocks, objects, light, daylight, contrast, seed, origin,
                directions[v, u, 0], directions[v, u, 1], directions[v, u, 2], pixel,
            )  # fmt: skip


@kernel
def soften_outlines(
    heights: Matrix, grid: Matrix, blocks: Matrix, objects: Matrix, light: Matrix, daylight: Matrix,
    contrast: float, seed: int,
    origin: Matrix, directions: Matrix, pixel: float, ranges: Matrix, radiance: Matrix,
) -> None:  # fmt: skip
    """Replace the radiance of pixels on an outline by the mean over the pixel's area, as a sensor sees it."""
    rows, columns = ranges.shape
    sharp = radiance.copy()
    for v in range(1, rows - 1):
        for u in range(1, columns - 1):
            here = ranges[v, u]
            jump = max(
                abs(ranges[v, u - 1] - here), abs(ranges[v, u + 1] - here),
                abs(ranges[v - 1, u] - here), abs(ranges[v + 1, u] - here),
            )  # fmt: skip
            if not jump > _EDGE * here or not math.isfinite(here):
                continue
            total = np.zeros(3)
            for k in range(_SUB * _SUB):
                su, sv = (k % _SUB - (_SUB - 1) / 2) / _SUB, (k // _SUB - (_SUB - 1) / 2) / _SUB
                ray = np.empty(3)
                for c in range(3):
                    ray[c] = (
                        directions[v, u, c]
                        + 0.5 * su * (directions[v, u + 1, c] - directions[v, u - 1, c])
                        + 0.5 * sv * (directions[v + 1, u, c] - directions[v - 1, u, c])
                    )
                ray /= math.sqrt(ray[0] ** 2 + ray[1] ** 2 + ray[2] ** 2)
                _, r, g, b = _shade(
                    heights,
                    grid,
                    blocks,
                    objects,
                    light,
                    daylight,
                    contrast,
                    seed,
                    origin,
                    ray[0],
                    ray[1],
                    ray[2],
                    pixel,
                )
                total[0] += r
                total[1] += g
                total[2] += b
            for c in range(3):
                sharp[v, u, c] = total[c] / (_SUB * _SUB)
    radiance[:] = sharp


def render(
    scene: Scene, light: Matrix, daylight: Matrix, origin: Matrix, directions: Matrix, pixel: float
) -> tuple[Matrix, Matrix]:
    """Look at a scene.

    Parameters
    ----------
    scene : Scene
    light : (11,) float64
        See `lamp_irradiance`; world coordinates.
    daylight : (5,) float64
        Irradiance from above, relative to the lamp's at 1 m, red, green, blue; strength of the caustics, and when, s.
    origin : (3,) float64
        World, m.
    directions : (H, W, 3) float64
        Unit vectors, world.
    pixel : float
        Angle between neighbouring pixels, rad.

    Returns
    -------
    ranges : (H, W) float64
        Along the ray, m; infinity where nothing is met within `FAR_M`.
    radiance : (H, W, 3) float64
        Linear RGB; 0 where nothing is met.
    """
    ranges = np.empty(directions.shape[:2])
    radiance = np.empty(directions.shape)
    arguments = (
        scene.heights, scene.grid, scene.blocks, scene.objects, light, daylight, scene.contrast, scene.seed,
        origin, directions, pixel, ranges, radiance,
    )  # fmt: skip
    shade_all(*arguments)
    soften_outlines(*arguments)
    return ranges, radiance
