"""Marine snow: particles that drift through the water, each seen by both cameras where it is."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.jit import kernel
from uw_recon_ros.simulate.render import lamp_irradiance
from uw_recon_ros.simulate.rig import Pose
from uw_recon_ros.types import FloatImage, Matrix

_BOX_M = 2.4
_AHEAD_M = 1.0  # middle of the box before the rig
_NEAREST_M = 0.20
_DRIFT_M_S = (0.03, -0.015, -0.01)
_ALBEDO = 0.75
_RADIUS_M = 0.0010  # median
_SPOT_PX = 0.45  # the lens's own blur
_DEFOCUS_PX_M = 1.3  # times the difference of inverse distances


@dataclass(frozen=True, eq=False)
class Snow:
    """Particles in a box that repeats itself in all directions.

    Parameters
    ----------
    places : (N, 3) float64
        World, m, at time zero, modulo the box.
    radii : (N,) float64
        m.
    """

    places: Matrix
    radii: Matrix


def make_snow(per_m3: float, seed: int) -> Snow:
    """Scatter particles evenly; sizes are lognormal."""
    rng = np.random.default_rng([seed, 4])
    count = round(per_m3 * _BOX_M**3)
    return Snow(rng.uniform(0.0, _BOX_M, (count, 3)), _RADIUS_M * np.exp(0.45 * rng.standard_normal(count)))


def snow_before(snow: Snow, pose: Pose, seconds: float) -> Matrix:
    """Where the particles around the rig are: (N, 3) float64 in the left optical frame, m."""
    middle = pose.position + _AHEAD_M * pose.rotation[:, 2]
    drifted = snow.places + seconds * np.array(_DRIFT_M_S)
    world = middle + np.mod(drifted - middle + _BOX_M / 2, _BOX_M) - _BOX_M / 2
    return np.ascontiguousarray((world - pose.position) @ pose.rotation)


@kernel
def _splat(
    u: Matrix, v: Matrix, z: Matrix, sigma: Matrix, opacity: Matrix, light: Matrix, ranges: Matrix, image: FloatImage
) -> None:
    rows, columns = ranges.shape
    for i in range(u.shape[0]):
        reach = 3.0 * sigma[i]
        for y in range(max(0, math.ceil(v[i] - reach)), min(rows - 1, math.floor(v[i] + reach)) + 1):
            for x in range(max(0, math.ceil(u[i] - reach)), min(columns - 1, math.floor(u[i] + reach)) + 1):
                if ranges[y, x] <= z[i]:
                    continue
                square = ((x - u[i]) ** 2 + (y - v[i]) ** 2) / (sigma[i] * sigma[i])
                share = opacity[i] * math.exp(-0.5 * square)
                for c in range(3):
                    image[y, x, c] = (1.0 - share) * image[y, x, c] + share * light[i, c]


def add_spots(
    image: FloatImage,
    ranges: Matrix,
    pixels: Matrix,
    distances: Matrix,
    radii_px: Matrix,
    light: Matrix,
    focus_m: float,
) -> None:
    """Draw round spots into an image, far ones first, each hidden where the scene is nearer.

    Parameters
    ----------
    image : (H, W, 3) float32
        Changed.
    ranges : (H, W) float64
        Of the scene, m.
    pixels : (N, 2) float64
        u, v.
    distances : (N,) float64
        From the camera, m.
    radii_px : (N,) float64
        Of the particles' images, px.
    light : (N, 3) float64
        What arrives of them at the camera.
    focus_m : float
        Distance the lens is focused on.
    """
    defocus = _DEFOCUS_PX_M * np.abs(1.0 / distances - 1.0 / focus_m)
    sigma = np.sqrt(_SPOT_PX**2 + (0.5 * radii_px) ** 2 + defocus**2)
    opacity = np.minimum(0.9, 2.0 * (0.5 * radii_px) ** 2 / sigma**2)
    order = np.argsort(-distances, kind="stable")
    u, v = (np.ascontiguousarray(pixels[order, k]) for k in (0, 1))
    _splat(u, v, distances[order], sigma[order], opacity[order], light[order], np.ascontiguousarray(ranges), image)


def snow_light(places: Matrix, lamp: Matrix, daylight: Matrix) -> Matrix:
    """Light that particles at `places` (N, 3), rig frame, send out: (N, 3)."""
    light = np.empty((len(places), 3))
    _light_snow(np.ascontiguousarray(places), lamp, np.ascontiguousarray(daylight), light)
    return light


@kernel
def _light_snow(places: Matrix, lamp: Matrix, daylight: Matrix, light: Matrix) -> None:
    for i in range(places.shape[0]):
        for c in range(3):
            lit = lamp_irradiance(lamp, c, places[i, 0], places[i, 1], places[i, 2]) if lamp[6] > 0.0 else 0.0
            light[i, c] = _ALBEDO * (0.6 * daylight[c] + 0.5 * lit)


def visible(places: Matrix) -> NDArray[np.intp]:
    """Indices of places before the camera and not at its very glass."""
    return np.flatnonzero(places[:, 2] > _NEAREST_M)
