"""The bottom of a simulated sea: a smooth relief and solid things on it, in world coordinates (x along the track,
y ahead, z up; metres; the origin is what the rig looks at)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.ndimage import gaussian_filter, maximum_filter

from uw_recon_ros.simulate.params import SimulateParams
from uw_recon_ros.types import Matrix

#: Kinds of things; a row of `Scene.objects` begins with one.
SPHERE, BOX, CYLINDER, AMPHORA = 1.0, 2.0, 3.0, 4.0
#: What a surface is made of.
SAND, STONE, WOOD, METAL, CLAY, TILES = 0, 1, 2, 3, 4, 5

#: Coefficients a side of a block with its own bounds.
BLOCK = 4

_X0, _Y0, _STEP = -6.0, -4.0, 0.04
_SHAPE = (348, 300)  # rows of y, columns of x: whole blocks


@dataclass(frozen=True, eq=False)
class Scene:
    """What the rays meet.

    Parameters
    ----------
    heights : (ny, nx) float64
        Coefficients of a uniform cubic B-spline surface z(x, y), m. Beyond its rim it goes on as at the rim.
    grid : (5,) float64
        x and y of coefficient (0, 0), step between coefficients, upper bound of z, material of the bottom.
    blocks : (my, mx, 2) float64
        Upper bounds of slope and z in every block of `BLOCK` by `BLOCK` coefficients and the eight around it.
    objects : (N, 17) float64
        Kind; centre (3); rotation local_from_world, row by row (9); three sizes, m; material.
    contrast : float
        Of all textures.
    seed : int
        Of all textures.
    """

    heights: Matrix
    grid: Matrix
    blocks: Matrix
    objects: Matrix
    contrast: float
    seed: int


def make_scene(params: SimulateParams) -> Scene:
    """Build the scene `params` names; random parts follow from the seed."""
    rng = np.random.default_rng([params.seed, 1])
    heights = _relief(params.scene, rng)
    objects = np.array(_things(params.scene, heights), np.float64).reshape(-1, 17)
    contrast = 1.0 if params.texture == "rich" else 0.08
    grid = np.array([_X0, _Y0, _STEP, heights.max(), float(SAND)])
    return Scene(heights, grid, bounds_of(heights, _STEP), objects, contrast, params.seed)


def bounds_of(heights: Matrix, step: float) -> Matrix:
    """Slope and height of a B-spline are bounded by the differences and values of the coefficients it is made of."""
    reach = 4 * BLOCK + 3  # three blocks and the spline's support on either side
    along_x = np.abs(np.diff(heights, axis=1, append=heights[:, -1:]))
    along_y = np.abs(np.diff(heights, axis=0, append=heights[-1:]))
    slope = np.hypot(maximum_filter(along_x, reach), maximum_filter(along_y, reach)) / step
    bounds = np.stack([slope, maximum_filter(heights, reach)], axis=-1)
    return np.ascontiguousarray(bounds[BLOCK // 2 :: BLOCK, BLOCK // 2 :: BLOCK])


def _relief(name: str, rng: np.random.Generator) -> Matrix:
    heights = np.zeros(_SHAPE)
    if name == "plane":
        return heights
    rough = 2.2 if name == "reef" else 1.0
    for wavelength_m, amplitude_m in ((1.6, 0.045), (0.5, 0.016), (0.2, 0.006)):
        heights += rough * amplitude_m * _smooth_noise(rng, wavelength_m / 4)
    y, x = np.mgrid[: _SHAPE[0], : _SHAPE[1]]
    x, y = _X0 + _STEP * x, _Y0 + _STEP * y
    crest = y + 0.25 * x + 0.1 * _smooth_noise(rng, 0.4)
    heights += 0.006 * np.sin(2 * math.pi * crest / 0.21)
    for _ in range(70 if name == "reef" else 34):
        _add_rock(heights, x, y, rng, clear_m=0.0 if name == "reef" else 0.62)
    return heights


def _smooth_noise(rng: np.random.Generator, sigma_m: float) -> Matrix:
    """White noise behind a Gaussian filter, of unit variance."""
    sigma = sigma_m / _STEP
    smooth: Matrix = gaussian_filter(rng.standard_normal(_SHAPE), sigma, mode="reflect") * (
        2 * sigma * math.sqrt(math.pi)
    )
    return smooth


def _add_rock(heights: Matrix, x: Matrix, y: Matrix, rng: np.random.Generator, clear_m: float) -> None:
    """A flattish boulder anywhere but in the middle of the scene."""
    cx, cy = rng.uniform(-3.5, 3.5), rng.uniform(-1.2, 4.0)
    radius, tall = rng.uniform(0.08, 0.3), rng.uniform(0.5, 0.9)
    distance = np.hypot(x - cx, y - cy) / radius
    if math.hypot(cx, cy) > clear_m + radius:
        heights += radius * tall * np.exp(-(distance**4))


def height_at(heights: Matrix, x: float, y: float) -> float:
    """Roughly where the seabed is, m: good enough to put things on it."""
    row, column = round((y - _Y0) / _STEP), round((x - _X0) / _STEP)
    return float(heights[row, column])


def _things(name: str, heights: Matrix) -> list[list[float]]:
    if name == "amphora":
        return [
            _thing(heights, AMPHORA, (-0.24, 0.05), 0.10, (12.0, 74.0, 24.0), (0.60, 0.135, 0.0), CLAY),
            _thing(heights, BOX, (0.42, 0.22), 0.09, (8.0, -6.0, 31.0), (0.17, 0.11, 0.12), WOOD),
            _thing(heights, SPHERE, (0.25, -0.22), 0.07, (0.0, 0.0, 0.0), (0.085, 0.0, 0.0), STONE),
            _thing(heights, CYLINDER, (0.1, 0.72), 0.05, (0.0, 86.0, -14.0), (0.055, 0.75, 0.0), METAL),
        ]
    if name == "pipe":
        return [
            _thing(heights, CYLINDER, (0.0, 0.0), 0.10, (0.0, 90.0, 12.0), (0.16, 2.5, 0.0), METAL),
            _thing(heights, BOX, (0.55, -0.3), 0.05, (0.0, 5.0, 25.0), (0.12, 0.09, 0.10), WOOD),
        ]
    if name == "wreck":
        return [
            _thing(heights, BOX, (0.1, 0.5), 0.25, (4.0, 9.0, 14.0), (0.75, 0.3, 0.42), METAL),
            _thing(heights, BOX, (-0.15, 0.5), 0.8, (4.0, 9.0, 14.0), (0.22, 0.2, 0.2), WOOD),
            _thing(heights, CYLINDER, (0.45, 0.45), 0.9, (3.0, 8.0, 0.0), (0.04, 0.9, 0.0), METAL),
            _thing(heights, CYLINDER, (0.42, 0.42), 1.05, (0.0, 82.0, 20.0), (0.025, 0.5, 0.0), METAL),
        ]
    return []


def _thing(
    heights: Matrix,
    kind: float,
    place: tuple[float, float],
    above_m: float,
    turns_deg: tuple[float, float, float],
    sizes: tuple[float, float, float],
    material: int,
) -> list[float]:
    """A thing whose centre is `above_m` over the seabed at `place`, turned about x, then y, then z."""
    return solid(kind, (*place, height_at(heights, *place) + above_m), turns_deg, sizes, material)


def solid(
    kind: float,
    center: tuple[float, float, float],
    turns_deg: tuple[float, float, float],
    sizes: tuple[float, float, float],
    material: int,
) -> list[float]:
    """A row of `Scene.objects`: a thing about `center`, turned about x, then y, then z."""
    local_from_world = _turn(turns_deg).T
    return [kind, *center, *local_from_world.ravel(), *sizes, float(material)]


def _turn(degrees: tuple[float, float, float]) -> Matrix:
    a, b, c = (math.radians(angle) for angle in degrees)
    about_x = np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
    about_y = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
    about_z = np.array([[math.cos(c), -math.sin(c), 0], [math.sin(c), math.cos(c), 0], [0, 0, 1]])
    turned: Matrix = about_z @ about_y @ about_x
    return turned
