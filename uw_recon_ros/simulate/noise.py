"""Procedural noise: numbers that look random and depend on the place alone."""

from __future__ import annotations

import math

from uw_recon_ros.jit import kernel


@kernel(inline=True)
def lattice(ix: int, iy: int, iz: int, seed: int) -> float:
    """A number in [0, 1) for a lattice point."""
    h = ix * 374761393 + iy * 668265263 + iz * 1440662683 + seed * 1274126177
    h = (h ^ (h >> 13)) * 1103515245
    h = (h ^ (h >> 17)) * 668265263
    return float((h ^ (h >> 15)) & 0xFFFFFF) / 16777216.0


@kernel(inline=True)
def fade(t: float) -> float:
    """Quintic step with two continuous derivatives."""
    return t * t * t * (t * (t * 6.0 - 15.0) + 10.0)


@kernel
def value_noise(x: float, y: float, z: float, seed: int) -> float:
    """Smooth noise of wavelength about 2 in [-1, 1]."""
    ix, iy, iz = math.floor(x), math.floor(y), math.floor(z)
    u, v, w = fade(x - ix), fade(y - iy), fade(z - iz)
    a = lattice(ix, iy, iz, seed) * (1.0 - u) + lattice(ix + 1, iy, iz, seed) * u
    b = lattice(ix, iy + 1, iz, seed) * (1.0 - u) + lattice(ix + 1, iy + 1, iz, seed) * u
    c = lattice(ix, iy, iz + 1, seed) * (1.0 - u) + lattice(ix + 1, iy, iz + 1, seed) * u
    d = lattice(ix, iy + 1, iz + 1, seed) * (1.0 - u) + lattice(ix + 1, iy + 1, iz + 1, seed) * u
    return 2.0 * ((a * (1.0 - v) + b * v) * (1.0 - w) + (c * (1.0 - v) + d * v) * w) - 1.0


@kernel
def detail(
    x: float, y: float, z: float, cell: float, octaves: int, persistence: float, footprint: float, seed: int
) -> float:
    """Noise with detail at all scales, of about unit variance.

    Parameters
    ----------
    x, y, z : float
        m.
    cell : float
        Size of the coarsest lattice, m.
    octaves : int
        How many, each with half the cell of the one before.
    persistence : float
        Amplitude of an octave relative to the one before.
    footprint : float
        Size of a pixel on the surface, m: octaves that it cannot resolve fade out, as they do in a camera.
    seed : int
    """
    total = 0.0
    power = 0.0
    amplitude = 1.0
    for octave in range(octaves):
        power += amplitude * amplitude
        visible = cell / footprint - 1.0
        if visible > 0.0:
            total += amplitude * min(visible, 1.0) * value_noise(x / cell, y / cell, z / cell, seed + octave)
        x, y, z = 0.8 * y + 0.6 * z, -0.8 * x + 0.36 * y - 0.48 * z, -0.6 * x - 0.48 * y + 0.64 * z
        cell *= 0.5
        amplitude *= persistence
    return total * 2.8 / math.sqrt(power)


@kernel
def pebbles(x: float, y: float, cell: float, seed: int) -> tuple[float, float, float]:
    """Round stones scattered on a plane, at most one to a lattice cell.

    Returns
    -------
    height : float
        0 outside of a stone, 1 in its middle.
    tone : float
        The stone's own random number, 0 to 1.
    distance : float
        To the stone's rim in m, negative inside.
    """
    ix, iy = math.floor(x / cell), math.floor(y / cell)
    nearest = 1e9
    best_tone = 0.0
    best_radius = cell
    for jx in range(ix - 1, ix + 2):
        for jy in range(iy - 1, iy + 2):
            size = lattice(jx, jy, 3, seed)
            if size < 0.35:
                continue
            radius = cell * 0.5 * size
            dx = x - cell * (jx + 0.2 + 0.6 * lattice(jx, jy, 1, seed))
            dy = y - cell * (jy + 0.2 + 0.6 * lattice(jx, jy, 2, seed))
            stretch = 0.7 + 0.6 * lattice(jx, jy, 5, seed)
            distance = math.sqrt(dx * dx * stretch + dy * dy / stretch) - radius
            if distance < nearest:
                nearest, best_radius, best_tone = distance, radius, lattice(jx, jy, 4, seed)
    height = 0.0
    if nearest < 0.0:
        inside = 1.0 + nearest / best_radius  # 0 in the middle, 1 at the rim
        height = math.sqrt(max(0.0, 1.0 - inside * inside))
    return height, best_tone, nearest
