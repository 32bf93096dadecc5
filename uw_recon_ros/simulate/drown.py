"""Ordinary pictures taken under water: any image, or stereo pair, whose depth is known. For benchmarks."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.evaluate import fill_rows
from uw_recon_ros.simulate.image_sensor import expose, exposure_of, to_light
from uw_recon_ros.simulate.snow import add_spots
from uw_recon_ros.simulate.water import Water, attenuate, daylight_veil, forward_scatter
from uw_recon_ros.types import FloatImage, Matrix, RawImage

_SNOW_SIZE_PX_M = 1.1  # image radius of a median particle times its distance


def drown_light(light: FloatImage, ranges: NDArray[np.floating], water: Water, *, daylight: float = 1.0) -> FloatImage:
    """Linear light (H, W, 3) that arrives through water from surfaces `ranges` (H, W) m away.

    NaN and infinity in `ranges`: the median range, for a hole in the truth is no hole in the scene.
    """
    reach = np.asarray(ranges, np.float32)
    known = np.isfinite(reach)
    if not known.all():
        reach = np.where(known, reach, np.float32(np.median(reach[known]) if known.any() else 1.0))
    direct = forward_scatter(attenuate(light, reach, water), reach, water)
    return direct + daylight_veil(reach, water, daylight)


def drown(
    image: RawImage,
    ranges: NDArray[np.floating],
    water: Water,
    rng: np.random.Generator,
    *,
    daylight: float = 1.0,
    noise: float = 1.0,
    exposure: float | None = None,
) -> RawImage:
    """Take a picture again, through water.

    Parameters
    ----------
    image : (H, W) or (H, W, 3) uint8 or uint16
        In air, lit by white light.
    ranges : (H, W) float
        Distance of what it shows, m; NaN or infinity = the median.
    water : Water
        See `uw_recon_ros.simulate.water.make_water`.
    rng : numpy.random.Generator
        For the sensor's noise.
    daylight : float
        Brightness of the water's veil relative to the scene's light.
    noise : float
        1 is a small camera at moderate gain, 0 none.
    exposure : float or None
        Gain before the sensor; None = the brightest twentieth just below white.

    Returns
    -------
    same shape and dtype as `image`
    """
    return _taken(drown_light(to_light(image), ranges, water, daylight=daylight), image, rng, noise, exposure)


def _taken(
    light: FloatImage, like: RawImage, rng: np.random.Generator, noise: float, exposure: float | None
) -> RawImage:
    gain = exposure_of(light) if exposure is None else exposure
    return expose(light, gain, rng, noise=noise, bits=8 * like.dtype.itemsize, mono=like.ndim == 2)


def ranges_from_disparity(disparity: FloatImage, nearest_m: float) -> FloatImage:
    """Distances that fit a disparity map when its largest disparity is `nearest_m` away.

    Parameters
    ----------
    disparity : (H, W) float
        px, > 0; NaN, infinity or <= 0 = unknown.
    nearest_m : float

    Returns
    -------
    (H, W) float32
        m; NaN = unknown.
    """
    known = np.isfinite(disparity) & (disparity > 0)
    if not known.any():
        raise ValueError("disparity: expected some positive values, got none")
    largest = float(disparity[known].max())
    ranges = np.full(disparity.shape, np.nan, np.float32)
    ranges[known] = nearest_m * largest / disparity[known]
    return ranges


def right_disparity(disparity: FloatImage) -> FloatImage:
    """The right camera's disparity map, by moving the left one's pixels; the nearest wins, holes take their row's
    farther neighbour."""
    rows, columns = disparity.shape
    moved = np.full((rows, columns), -np.inf)
    known = np.isfinite(disparity) & (disparity > 0)
    v, u = np.nonzero(known)
    d = disparity[v, u].astype(np.float64)
    for rounded in (np.floor(u - d).astype(int), np.ceil(u - d).astype(int)):
        inside = (rounded >= 0) & (rounded < columns)
        np.maximum.at(moved, (v[inside], rounded[inside]), d[inside])
    return fill_rows(np.where(np.isfinite(moved), moved, np.nan).astype(np.float32))


def drown_pair(
    left: RawImage,
    right: RawImage,
    disparity: FloatImage,
    water: Water,
    seed: int,
    *,
    nearest_m: float = 1.0,
    daylight: float = 1.0,
    noise: float = 1.0,
    snow: int = 0,
    gain_difference: float = 0.0,
) -> tuple[RawImage, RawImage]:
    """Take a rectified pair again, through water.

    Parameters
    ----------
    left, right : (H, W) or (H, W, 3) uint8 or uint16
        In air.
    disparity : (H, W) float
        Of the left image, px; NaN, infinity or <= 0 = unknown.
    water : Water
    seed : int
        Of snow and noise.
    nearest_m : float
        Distance of the largest disparity.
    daylight, noise : float
        As in `drown`.
    snow : int
        Particles, seen by both cameras at their own disparities.
    gain_difference : float
        How much brighter the right camera is.

    Returns
    -------
    left, right : same shape and dtype
    """
    rng = np.random.default_rng([seed, 5])
    maps = disparity, right_disparity(disparity)
    largest = float(np.nanmax(np.where(np.isfinite(disparity), disparity, np.nan)))
    flakes = _flakes(rng, snow, nearest_m, largest, (left.shape[0], left.shape[1]))
    lights = []
    for view, (image, d) in enumerate(zip((left, right), maps, strict=True)):
        ranges = nearest_m * largest / np.where(np.isfinite(d) & (d > 0), d, np.nan)
        light = drown_light(to_light(image), ranges, water, daylight=daylight)
        if snow:
            _snow(light, np.nan_to_num(ranges, nan=np.inf), flakes, view, nearest_m * largest, water, daylight)
        lights.append(light)
    gain = exposure_of(lights[0])
    taken_left = _taken(lights[0], left, rng, noise, gain)
    return taken_left, _taken(lights[1], right, rng, noise, gain * (1.0 + gain_difference))


def _flakes(rng: np.random.Generator, count: int, nearest_m: float, largest: float, shape: tuple[int, int]) -> Matrix:
    """u, v, distance and relative size of particles, evenly in the volume the left camera sees: (N, 4)."""
    far = 3.0 * nearest_m
    distance = far * np.cbrt(rng.uniform((0.25 * nearest_m / far) ** 3, 1.0, count))
    margin = largest * nearest_m / distance  # the right camera sees what is beyond the left one's right edge
    u = rng.uniform(0.0, 1.0, count) * (shape[1] + margin)
    v = rng.uniform(0.0, shape[0], count)
    return np.stack([u, v, distance, np.exp(0.45 * rng.standard_normal(count))], axis=1)


def _snow(
    light: FloatImage, ranges: Matrix, flakes: Matrix, view: int, scale: float, water: Water, daylight: float
) -> None:
    """Draw the particles into one camera; `scale` is distance times disparity."""
    distances = flakes[:, 2]
    pixels = flakes[:, :2] - np.stack([view * scale / distances, np.zeros(len(flakes))], axis=1)
    veil = daylight_veil(distances.astype(np.float32), water, daylight)
    arriving = 0.75 * np.exp(-distances[:, None] * water.attenuation) + veil
    focus = float(np.median(ranges[np.isfinite(ranges)]))
    add_spots(light, ranges, pixels, distances, _SNOW_SIZE_PX_M * flakes[:, 3] / distances, arriving, focus)
