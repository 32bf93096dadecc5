"""The rig's lamp: an uneven beam, and the glow of the water in it."""

from __future__ import annotations

import math

import numpy as np

from uw_recon_ros.jit import kernel
from uw_recon_ros.simulate.render import lamp_irradiance
from uw_recon_ros.simulate.rig import Pose
from uw_recon_ros.simulate.water import Water
from uw_recon_ros.types import FloatImage, Matrix

_PLACE = (-0.32, -0.22, -0.05)  # in the left optical frame, m: up on the left
_AIM = (0.20, 0.13, 1.0)
_HALF_CONE = math.radians(30.0)
_SCATTER = 0.035  # backscattered share of the light a metre, relative to the mean attenuation
_GLOW_FAR_M = 8.0
_GLOW_STEPS = 40
_GLOW_PIXELS = 16


def lamp_in_rig(power: float, water: Water) -> Matrix:
    """The lamp as kernels take it (`uw_recon_ros.simulate.render.lamp_irradiance`), in the left optical frame."""
    aim = np.array(_AIM) / np.linalg.norm(_AIM)
    return np.array([*_PLACE, *aim, power, math.cos(_HALF_CONE), *water.attenuation])


def lamp_in_world(lamp: Matrix, pose: Pose) -> Matrix:
    """The same in world coordinates."""
    place = pose.rotation @ lamp[:3] + pose.position
    return np.concatenate([place, pose.rotation @ lamp[3:6], lamp[6:]])


def glow_table(lamp: Matrix, water: Water, origin: Matrix, directions: Matrix) -> Matrix:
    """Light scattered from the beam into coarse rays, summed up to a number of ranges.

    Parameters
    ----------
    lamp : (11,) float64
        In the rig's frame.
    water : Water
    origin : (3,) float64
        Of the camera, in the rig's frame, m.
    directions : (H, W, 3) float64
        Of its pixels, unit vectors, in the rig's frame.

    Returns
    -------
    (_GLOW_STEPS + 1, H', W', 3) float64
        At every 16th pixel, up to the range ``_GLOW_FAR_M (k / _GLOW_STEPS)^2``.
    """
    coarse = np.ascontiguousarray(directions[::_GLOW_PIXELS, ::_GLOW_PIXELS])
    table = np.zeros((_GLOW_STEPS + 1, *coarse.shape))
    if lamp[6] > 0:
        _sum_glow(lamp, _SCATTER * float(water.attenuation.mean()), origin, coarse, table)
    return table


@kernel
def _sum_glow(lamp: Matrix, scatter: float, origin: Matrix, directions: Matrix, table: Matrix) -> None:
    """Midpoint rule along each ray; ranges grow with the square, for the glow is brightest nearby."""
    steps = table.shape[0] - 1
    for v in range(directions.shape[0]):
        for u in range(directions.shape[1]):
            for k in range(steps):
                begin, end = _GLOW_FAR_M * (k / steps) ** 2, _GLOW_FAR_M * ((k + 1) / steps) ** 2
                s = 0.5 * (begin + end)
                x = origin[0] + s * directions[v, u, 0]
                y = origin[1] + s * directions[v, u, 1]
                z = origin[2] + s * directions[v, u, 2]
                for c in range(3):
                    lit = lamp_irradiance(lamp, c, x, y, z) * math.exp(-lamp[8 + c] * s)
                    table[k + 1, v, u, c] = table[k, v, u, c] + scatter * lit * (end - begin)


@kernel
def _look_up(table: Matrix, ranges: Matrix, glow: FloatImage) -> None:
    steps, rows, columns = table.shape[0] - 1, table.shape[1], table.shape[2]
    for v in range(ranges.shape[0]):
        for u in range(ranges.shape[1]):
            reach = min(ranges[v, u] / _GLOW_FAR_M, 1.0) if ranges[v, u] == ranges[v, u] else 1.0
            k = min(math.sqrt(max(reach, 0.0)) * steps, steps - 1e-6)
            y, x = min(v / _GLOW_PIXELS, rows - 1.000001), min(u / _GLOW_PIXELS, columns - 1.000001)
            k0, y0, x0 = int(k), int(y), int(x)
            k -= k0
            y -= y0
            x -= x0
            for c in range(3):
                near = (1 - y) * ((1 - x) * table[k0, y0, x0, c] + x * table[k0, y0, x0 + 1, c]) + y * (
                    (1 - x) * table[k0, y0 + 1, x0, c] + x * table[k0, y0 + 1, x0 + 1, c]
                )
                far = (1 - y) * ((1 - x) * table[k0 + 1, y0, x0, c] + x * table[k0 + 1, y0, x0 + 1, c]) + y * (
                    (1 - x) * table[k0 + 1, y0 + 1, x0, c] + x * table[k0 + 1, y0 + 1, x0 + 1, c]
                )
                glow[v, u, c] = (1 - k) * near + k * far


def glow_at(table: Matrix, pixels: Matrix, distances: Matrix) -> Matrix:
    """The glow up to single points (N,) m away at pixels (N, 2) u, v, roughly: (N, 3)."""
    place = np.nan_to_num(pixels[:, ::-1] / _GLOW_PIXELS, nan=0.0)
    row, column = np.rint(place).astype(int).clip(0, np.array(table.shape[1:3]) - 1).T
    step = np.rint(np.sqrt(np.minimum(distances / _GLOW_FAR_M, 1.0)) * (table.shape[0] - 1)).astype(int)
    glow: Matrix = table[step, row, column]
    return glow


def lamp_glow(table: Matrix, ranges: Matrix) -> FloatImage:
    """The lamp's backscatter up to the range of each pixel: (H, W, 3) float32."""
    glow = np.empty((*ranges.shape, 3), np.float32)
    _look_up(table, np.ascontiguousarray(ranges, np.float64), glow)
    return glow
