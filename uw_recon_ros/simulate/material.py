"""What surfaces look like: solid textures with detail down to the pixel, so that both cameras see the same."""

from __future__ import annotations

import math

from uw_recon_ros.jit import kernel
from uw_recon_ros.simulate.noise import detail, pebbles
from uw_recon_ros.simulate.scene import CLAY, METAL, SAND, STONE, TILES, WOOD

Color = tuple[float, float, float]

#: Side of a tile, m.
TILE_M = 0.25


@kernel(inline=True)
def _step(low: float, high: float, x: float) -> float:
    """0 below `low`, 1 above `high`, smooth between."""
    t = min(max((x - low) / (high - low), 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@kernel(inline=True)
def _mix(a: Color, b: Color, share: float) -> Color:
    return a[0] + (b[0] - a[0]) * share, a[1] + (b[1] - a[1]) * share, a[2] + (b[2] - a[2]) * share


@kernel(inline=True)
def _scale(a: Color, factor: float) -> Color:
    return a[0] * factor, a[1] * factor, a[2] * factor


@kernel
def sand(x: float, y: float, z: float, footprint: float, contrast: float, seed: int) -> Color:
    """Sand with stones of two sizes and patches of algae."""
    grain = detail(x, y, 0.4 * z, 0.16, 7, 0.86, footprint, seed)
    patch = detail(x, y, z, 0.9, 5, 0.62, footprint, seed + 40)
    color = _mix((0.50, 0.44, 0.34), (0.20, 0.24, 0.12), 0.75 * contrast * _step(0.5, 1.6, patch))
    color = _scale(color, max(0.08, 1.0 + 0.32 * contrast * grain))
    for scale in range(2):
        cell = 0.085 if scale == 0 else 0.026
        height, tone, distance = pebbles(x, y, cell, seed + 60 + scale)
        rim = _step(-0.5 * footprint, 0.12 * cell, distance)
        color = _scale(color, 1.0 - contrast * 0.45 * (1.0 - rim))
        if distance < 0.5 * footprint:
            inside = min(0.5 - distance / footprint, 1.0)
            speckle = 1.0 + 0.28 * detail(x, y, z, 0.012, 3, 0.9, footprint, seed + 70)
            stone = _scale(
                _mix((0.18, 0.16, 0.15), (0.66, 0.60, 0.52), tone), (0.55 + 0.45 * height) * max(speckle, 0.2)
            )
            color = _mix(color, stone, inside * contrast)
    return color


@kernel
def clay(x: float, y: float, z: float, footprint: float, contrast: float, seed: int) -> Color:
    """Terracotta under a crust of lime and algae, with rings from the potter's wheel (the axis is z)."""
    mottle = detail(x, y, z, 0.10, 7, 0.85, footprint, seed + 100)
    crust = detail(x, y, z, 0.14, 6, 0.80, footprint, seed + 120)
    green = detail(x, y, z, 0.22, 6, 0.72, footprint, seed + 140)
    color = _scale((0.52, 0.27, 0.15), max(0.08, 1.0 + 0.30 * contrast * mottle))
    wheel = math.sin(2.0 * math.pi * z / 0.017 + 0.6 * mottle)
    color = _scale(color, 1.0 + 0.08 * contrast * wheel * min(0.004 / footprint, 1.0))
    rough = max(0.2, 1.0 + 0.30 * detail(x, y, z, 0.024, 4, 0.9, footprint, seed + 160))
    color = _mix(color, _scale((0.66, 0.62, 0.53), rough), 0.85 * contrast * _step(0.55, 0.95, crust))
    return _mix(color, _scale((0.17, 0.20, 0.10), rough * rough), 0.80 * contrast * _step(0.7, 1.3, green))


@kernel
def wood(x: float, y: float, z: float, footprint: float, contrast: float, seed: int) -> Color:
    """Planks along x with their grain, nails and gaps."""
    plank = math.floor(z / 0.062 + 0.5)
    across = abs(z / 0.062 + 0.5 - plank - 0.5) * 0.062
    grain = detail(0.12 * x, y, z + 3.1 * plank, 0.035, 5, 0.85, footprint, seed + 200)
    growth = detail(x, y, z, 0.12, 6, 0.80, footprint, seed + 220)
    color = _scale((0.36, 0.26, 0.17), max(0.08, 1.0 + contrast * (0.30 * grain + 0.12 * math.sin(5.0 * plank))))
    rough = max(0.2, 1.0 + 0.28 * detail(x, y, z, 0.02, 4, 0.9, footprint, seed + 240))
    color = _mix(color, _scale((0.56, 0.54, 0.44), rough), 0.8 * contrast * _step(0.8, 1.3, growth))
    gap = 1.0 - _step(0.0, 0.0025 + 0.5 * footprint, 0.031 - across)
    return _scale(color, 1.0 - 0.8 * contrast * gap)


@kernel
def metal(x: float, y: float, z: float, footprint: float, contrast: float, seed: int) -> Color:
    """Painted once, rusty now; bands around the z axis."""
    rust = detail(x, y, z, 0.20, 6, 0.82, footprint, seed + 300)
    pits = detail(x, y, z, 0.03, 5, 0.88, footprint, seed + 320)
    paint = _mix((0.42, 0.40, 0.30), (0.30, 0.33, 0.34), _step(-0.002, 0.002, math.sin(2.0 * math.pi * z / 0.5) * 0.01))
    color = _mix(paint, _scale((0.36, 0.18, 0.09), max(0.1, 1.0 + 0.35 * pits)), contrast * _step(-0.2, 0.5, rust))
    return _scale(color, max(0.08, 1.0 + 0.25 * contrast * pits))


@kernel
def stone(x: float, y: float, z: float, footprint: float, contrast: float, seed: int) -> Color:
    """A cut stone, pitted and overgrown."""
    rough = detail(x, y, z, 0.08, 6, 0.88, footprint, seed + 400)
    growth = detail(x, y, z, 0.09, 6, 0.78, footprint, seed + 420)
    color = _scale((0.44, 0.42, 0.38), max(0.08, 1.0 + 0.34 * contrast * rough))
    return _mix(color, (0.50, 0.20, 0.24), 0.75 * contrast * _step(0.7, 1.1, growth))


@kernel
def tiles(x: float, y: float, z: float, footprint: float, contrast: float, seed: int) -> Color:
    """Printed tiles, each like the other to the last speck, with grout between."""
    side, grout = TILE_M, 0.006
    u, v = x - side * math.floor(x / side), y - side * math.floor(y / side)
    print_ = detail(u, v, 0.0, 0.06, 5, 0.85, footprint, seed + 500)
    color = _scale((0.34, 0.48, 0.56), max(0.1, 1.0 + 0.32 * contrast * print_))
    rim = min(min(u, side - u), min(v, side - v))
    gap = 1.0 - _step(0.5 * grout - 0.5 * footprint, 0.5 * grout + 0.5 * footprint, rim)
    return _mix(color, (0.62, 0.60, 0.55), gap)


@kernel
def albedo(material: int, x: float, y: float, z: float, footprint: float, contrast: float, seed: int) -> Color:
    """Share of red, green and blue light that a surface reflects.

    Parameters
    ----------
    material : int
        One of `uw_recon_ros.simulate.scene`.
    x, y, z : float
        In the thing's own coordinates, m.
    footprint : float
        Size of a pixel on the surface, m.
    contrast : float
        1 = rich.
    seed : int
    """
    if material == SAND:
        return sand(x, y, z, footprint, contrast, seed)
    if material == CLAY:
        return clay(x, y, z, footprint, contrast, seed)
    if material == WOOD:
        return wood(x, y, z, footprint, contrast, seed)
    if material == METAL:
        return metal(x, y, z, footprint, contrast, seed)
    if material == STONE:
        return stone(x, y, z, footprint, contrast, seed)
    if material == TILES:
        return tiles(x, y, z, footprint, contrast, seed)
    return 0.5, 0.5, 0.5
