"""The bottom below a track: relief and things all over it, or a floor that repeats itself."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from scipy.ndimage import gaussian_filter

from uw_recon_ros.simulate.scene import (
    AMPHORA,
    BLOCK,
    BOX,
    CLAY,
    CYLINDER,
    METAL,
    SAND,
    SPHERE,
    STONE,
    TILES,
    WOOD,
    Scene,
    bounds_of,
    solid,
)
from uw_recon_ros.simulate.tracks import Course
from uw_recon_ros.types import Matrix

STEP_M = 0.04
RIPPLE_M = 0.25  # crest to crest
_THINGS_PER_M2 = 0.8
_CRAWL_M_S = 0.05
#: Kind, height of the centre over the bottom, turns, sizes, material; one is drawn for each place.
_KINDS = (
    (AMPHORA, 0.08, (12.0, 74.0), (0.42, 0.095, 0.0), CLAY),
    (BOX, 0.05, (8.0, -6.0), (0.12, 0.08, 0.07), WOOD),
    (SPHERE, 0.05, (0.0, 0.0), (0.08, 0.0, 0.0), STONE),
    (CYLINDER, 0.04, (0.0, 86.0), (0.05, 0.35, 0.0), METAL),
)


def make_bottom(course: Course) -> Scene:
    """Lay a bottom under the whole track, with a margin as wide as what the cameras see."""
    params, kind = course.params, course.course.bottom
    rng = np.random.default_rng([params.seed, 8])
    x0, y0, shape = _extent(course)
    heights = _relief(kind, rng, x0, y0, shape)
    objects = _scatter(course, rng, heights, x0, y0) if kind == "objects" else []
    material = TILES if kind == "tiles" else SAND
    grid = np.array([x0, y0, STEP_M, heights.max(), float(material)])
    contrast = 1.0 if params.texture == "rich" else 0.08
    table = np.array(objects + _movers(course, rng), np.float64).reshape(-1, 17)
    return Scene(heights, grid, bounds_of(heights, STEP_M), table, contrast, params.seed)


def _extent(course: Course) -> tuple[float, float, tuple[int, int]]:
    p = course.params
    track = np.array([course.pose(k / p.rate_hz).position[:2] for k in range(p.frames)])
    margin = 2.0 * p.distance_m + 0.5
    low, size = track.min(axis=0) - margin, np.ptp(track, axis=0) + 2 * margin
    columns, rows = (BLOCK * math.ceil(length / STEP_M / BLOCK) for length in size)
    return float(low[0]), float(low[1]), (rows, columns)


def _relief(kind: str, rng: np.random.Generator, x0: float, y0: float, shape: tuple[int, int]) -> Matrix:
    heights = np.zeros(shape)
    if kind == "ripples":
        heights += 0.012 * np.sin(2 * math.pi * (y0 + STEP_M * np.arange(shape[0])) / RIPPLE_M)[:, None]
    if kind in {"objects", "relief"}:
        for wavelength_m, amplitude_m in ((1.6, 0.045), (0.5, 0.016), (0.2, 0.006)):
            sigma = wavelength_m / 4 / STEP_M
            smooth = gaussian_filter(rng.standard_normal(shape), sigma, mode="reflect")
            heights += amplitude_m * smooth * 2 * sigma * math.sqrt(math.pi)
        _add_rocks(heights, rng)
    return heights


def _add_rocks(heights: Matrix, rng: np.random.Generator) -> None:
    rows, columns = heights.shape
    for _ in range(round(rows * columns * STEP_M**2 * 0.8)):
        row, column = rng.uniform(0, rows), rng.uniform(0, columns)
        radius, tall = rng.uniform(0.06, 0.2) / STEP_M, rng.uniform(0.5, 0.9)
        reach = math.ceil(2 * radius)
        y = slice(max(0, int(row) - reach), int(row) + reach)
        x = slice(max(0, int(column) - reach), int(column) + reach)
        v, u = np.ogrid[y.start : min(y.stop, rows), x.start : min(x.stop, columns)]
        heights[y, x] += radius * STEP_M * tall * np.exp(-((np.hypot(u - column, v - row) / radius) ** 4))


def _scatter(course: Course, rng: np.random.Generator, heights: Matrix, x0: float, y0: float) -> list[list[float]]:
    rows, columns = heights.shape
    found = []
    for _ in range(round(rows * columns * STEP_M**2 * _THINGS_PER_M2)):
        row, column = int(rng.integers(rows)), int(rng.integers(columns))
        kind, above, (a, b), sizes, material = _KINDS[int(rng.integers(len(_KINDS)))]
        turns = (a, b, float(rng.uniform(0.0, 360.0)))
        place = (x0 + STEP_M * column, y0 + STEP_M * row, float(heights[row, column]) + above)
        found.append(solid(kind, place, turns, sizes, material))
    return found


def _movers(course: Course, rng: np.random.Generator) -> list[list[float]]:
    """Boxes beside the track; `moved` lets them crawl."""
    p, found = course.params, []
    for _ in range(course.course.movers):
        at = course.pose(float(rng.uniform(0.0, p.frames / p.rate_hz))).position
        offset = rng.uniform(-0.3, 0.3, 2)
        place = (float(at[0] + offset[0]), float(at[1] + offset[1]), 0.06)
        found.append(solid(BOX, place, (0.0, 0.0, float(rng.uniform(0, 360))), (0.12, 0.09, 0.06), STONE))
    return found


def moved(scene: Scene, movers: int, seconds: float) -> Scene:
    """The scene at a later time: its last `movers` things crawl along their own x axis, to and fro."""
    if not movers:
        return scene
    objects = scene.objects.copy()
    way = _CRAWL_M_S * seconds % 4.0
    objects[-movers:, 1:4] += (2.0 - abs(way - 2.0)) * objects[-movers:, 4:7]
    return replace(scene, objects=objects)


def without_movers(scene: Scene, movers: int) -> Scene:
    """What stays where it is."""
    return replace(scene, objects=np.ascontiguousarray(scene.objects[: len(scene.objects) - movers]))
