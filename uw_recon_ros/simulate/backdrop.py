"""What is seen in open water and is no surface to reconstruct: waves from below, and the lamps of others."""

from __future__ import annotations

import math

import numpy as np

from uw_recon_ros.simulate.rig import Pose, project
from uw_recon_ros.simulate.water import Water
from uw_recon_ros.types import CameraModel, FloatImage, Matrix

_WINDOW = 0.661  # cosine of 48.6 degrees: steeper rays see the sky (Snell's window), others the water mirrored
_EDGE = 0.03  # over which waves blur it
_SKY, _MIRROR = 1.5, 0.12  # light of either, relative to the daylight at the surface
_WAVES = ((1.3, 0.4, 1.1), (-0.7, 1.5, 1.7), (3.1, 2.2, 2.3), (-2.6, 3.9, 2.9))  # 1/m along x and y, 1/s
_STEEP = 0.06  # slope of a wave
_BODY_M, _POWER = 0.03, 40.0  # radius of a lamp's glass; its light, relative to white
_HALO, _HALO_M = 0.02, 0.12  # share that the water scatters around it, and how wide


def surface_from_below(directions: Matrix, origin: Matrix, seconds: float, depth_m: float, water: Water) -> FloatImage:
    """Light of the waves above, (H, W, 3) relative to the daylight; 0 where a ray does not lead up.

    Parameters
    ----------
    directions : (H, W, 3) float64
        Unit vectors, world, z up.
    origin : (3,) float64
        World, m.
    seconds : float
        Waves move.
    depth_m : float
        Of the camera.
    water : Water
    """
    up = np.maximum(directions[..., 2], 1e-3)
    reach = depth_m / up
    x, y = (origin[i] + reach * directions[..., i] for i in (0, 1))
    slope_x, slope_y = np.zeros_like(x), np.zeros_like(x)
    for a, b, rate in _WAVES:
        bend = _STEEP * np.cos(a * x + b * y + rate * seconds) / math.hypot(a, b)
        slope_x, slope_y = slope_x + a * bend, slope_y + b * bend
    cosine = (up - slope_x * directions[..., 0] - slope_y * directions[..., 1]) / np.sqrt(1 + slope_x**2 + slope_y**2)
    sky = 1 / (1 + np.exp(-(cosine - _WINDOW) / _EDGE))
    sent = np.where(directions[..., 2] > 1e-3, _MIRROR + (_SKY - _MIRROR) * sky, 0.0)
    return np.asarray(sent[..., None] * np.exp(-reach[..., None] * water.attenuation), np.float32)


def place_lamps(count: int, seed: int, distance_m: float, first: Pose) -> Matrix:
    """Where others hold their lamps, towards the rig: (N, 3) world, m; behind the scene and over it."""
    rng = np.random.default_rng([seed, 7])
    away = distance_m * rng.uniform(1.5, 3.0, count)
    in_rig = away[:, None] * np.column_stack(
        [rng.uniform(-0.4, 0.4, count), rng.uniform(-0.5, 0.0, count), np.ones(count)]
    )
    places: Matrix = in_rig @ first.rotation.T + first.position
    return places


def add_lamps(light: FloatImage, in_camera: Matrix, camera: CameraModel, ranges: Matrix, water: Water) -> None:
    """Add lamps at places (N, 3) in the camera's frame, and the water's glow around them, where nothing hides them."""
    rows, columns = np.indices(light.shape[:2], dtype=np.float32)
    for place in in_camera[in_camera[:, 2] > 0.1]:
        (u,), (v,) = project(place[None], camera)
        away = float(np.linalg.norm(place))
        metres = np.hypot(rows - v, columns - u) * (place[2] / camera.k[0, 0])
        shape = (metres < _BODY_M) + _HALO / (1 + (metres / _HALO_M) ** 2) ** 1.5
        arriving = _POWER * np.exp(-away * water.attenuation) / max(away, 1.0)
        light += np.asarray((shape * (ranges > away))[..., None] * arriving, np.float32)
