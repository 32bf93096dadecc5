"""Where rays meet things: against closed forms and against dense sampling along the ray."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from uw_recon_ros.simulate import SimulateParams
from uw_recon_ros.simulate.ray_casting import FAR_M, cast, is_blocked, nearest_hit
from uw_recon_ros.simulate.scene import BLOCK, Scene, make_scene
from uw_recon_ros.simulate.seabed import seabed_height, seabed_slopes
from uw_recon_ros.simulate.solids import amphora_distance, hit_amphora, hit_box, hit_cylinder, hit_sphere
from uw_recon_ros.types import Matrix

RNG_SEED = 20240611


def rays(count: int, around_m: float) -> tuple[Matrix, Matrix]:
    """From points on a sphere about the origin towards points near it."""
    rng = np.random.default_rng(RNG_SEED)
    origins = rng.standard_normal((count, 3))
    origins *= 3 * around_m / np.linalg.norm(origins, axis=1, keepdims=True)
    towards = rng.uniform(-around_m, around_m, (count, 3)) - origins
    return origins, towards / np.linalg.norm(towards, axis=1, keepdims=True)


def first_inside(
    origin: Matrix, direction: Matrix, inside: Callable[[Matrix], Matrix], far: float, step: float = 5e-4
) -> float:
    """Distance to the first sample inside of something, by brute force."""
    t = np.arange(0.0, far, step)
    points = origin + t[:, None] * direction
    found = inside(points)
    return float(t[found.argmax()]) if found.any() else math.inf


def below_cylinder(p: Matrix) -> Matrix:
    """Signed measure of a point of the cylinder: negative inside, 0 on the surface."""
    return np.maximum(np.hypot(p[:, 0], p[:, 1]) - 0.25, np.abs(p[:, 2]) - 0.4)


@pytest.mark.parametrize(
    ("hit", "outside"),
    [
        (lambda o, d: hit_sphere(*o, *d, 0.4), lambda p: np.linalg.norm(p, axis=1) - 0.4),
        (lambda o, d: hit_box(*o, *d, 0.3, 0.2, 0.4), lambda p: (np.abs(p) - [0.3, 0.2, 0.4]).max(axis=1)),
        (lambda o, d: hit_cylinder(*o, *d, 0.25, 0.4), below_cylinder),
        (
            lambda o, d: hit_amphora(*o, *d, 0.9, 0.2, FAR_M),
            lambda p: np.array([amphora_distance(*point, 0.9, 0.2) for point in p]),
        ),
    ],
    ids=["sphere", "box", "cylinder", "amphora"],
)
def test_solids_against_brute_force(hit: Callable[..., Any], outside: Callable[[Matrix], Matrix]) -> None:
    hits = 0
    for origin, direction in zip(*rays(60, 0.5), strict=True):
        t, *normal = hit(origin, direction)
        expected = first_inside(origin, direction, lambda p: outside(p) < 0, 3.2)
        if math.isinf(t):  # at most a graze shorter than the sampling
            assert math.isinf(expected)
            continue
        hits += 1
        assert outside((origin + t * direction)[None])[0] == pytest.approx(0.0, abs=1e-6)
        assert expected == math.inf or t == pytest.approx(expected, abs=6e-4)
        assert np.linalg.norm(normal) == pytest.approx(1.0, abs=1e-9)
        assert np.dot(normal, direction) < 1e-6
    assert hits >= 15


@pytest.mark.parametrize("name", ["amphora", "reef"])
def test_the_seabed_is_met_where_the_ray_first_goes_below_it(name: str) -> None:
    scene = make_scene(SimulateParams(scene=name))
    rng = np.random.default_rng(RNG_SEED)
    nothing = scene.objects[:0]
    for _ in range(60):
        origin = np.array([*rng.uniform(-1, 1, 2), rng.uniform(0.5, 1.2)])
        direction = np.array([*rng.uniform(-1, 1, 2), rng.uniform(-1.0, -0.05)])
        direction /= np.linalg.norm(direction)
        ranges = cast(scene.heights, scene.grid, scene.blocks, nothing, origin, direction[None], np.array([8.0]))
        t = np.arange(0.0, 8.0, 1e-3)
        p = origin + t[:, None] * direction
        gaps = np.array([z - seabed_height(scene.heights, scene.grid, x, y) for x, y, z in p])
        expected = t[(gaps < 0).argmax()] if (gaps < 0).any() else math.inf
        assert ranges[0] == pytest.approx(expected, abs=2e-3)
        if math.isfinite(ranges[0]):
            x, y, z = origin + ranges[0] * direction
            assert abs(z - seabed_height(scene.heights, scene.grid, x, y)) < 1e-6


def test_block_bounds_hold_everywhere() -> None:
    scene = make_scene(SimulateParams(scene="reef"))
    rng = np.random.default_rng(RNG_SEED)
    x, y = rng.uniform(-5.9, 5.9, 4000), rng.uniform(-3.9, 9.9, 4000)
    for a, b in zip(x, y, strict=True):
        column = int((a - scene.grid[0]) / (BLOCK * scene.grid[2]))
        row = int((b - scene.grid[1]) / (BLOCK * scene.grid[2]))
        slope, top = scene.blocks[row, column]
        assert seabed_height(scene.heights, scene.grid, a, b) <= top
        assert math.hypot(*seabed_slopes(scene.heights, scene.grid, a, b)) <= slope


def test_slopes_are_those_of_the_height() -> None:
    scene = make_scene(SimulateParams())
    for x, y in np.random.default_rng(RNG_SEED).uniform(-2, 2, (50, 2)):
        e = 1e-6
        along_x = (
            seabed_height(scene.heights, scene.grid, x + e, y) - seabed_height(scene.heights, scene.grid, x - e, y)
        ) / (2 * e)
        along_y = (
            seabed_height(scene.heights, scene.grid, x, y + e) - seabed_height(scene.heights, scene.grid, x, y - e)
        ) / (2 * e)
        assert seabed_slopes(scene.heights, scene.grid, x, y) == pytest.approx((along_x, along_y), abs=1e-6)


def scene_arrays(scene: Scene) -> tuple[Matrix, Matrix, Matrix, Matrix]:
    return scene.heights, scene.grid, scene.blocks, scene.objects


def test_the_nearest_of_all_things_is_met() -> None:
    scene = make_scene(SimulateParams())
    ball = scene.objects[2]
    above = ball[1:4] + np.array([0.0, 0.0, 1.0])
    t, which, *normal = nearest_hit(*scene_arrays(scene), *above, 0.0, 0.0, -1.0, FAR_M)
    assert (t, which) == (pytest.approx(1.0 - ball[13]), 2)
    assert normal == pytest.approx([0, 0, 1])
    t, which, *_ = nearest_hit(*scene_arrays(scene), 2.5, 3.5, 1.0, 0.0, 0.0, -1.0, FAR_M)
    assert which == -1
    t, which, *_ = nearest_hit(*scene_arrays(scene), 0.0, 0.0, 1.0, 0.0, 0.0, 1.0, FAR_M)
    assert (t, which) == (math.inf, -2)


def test_turned_things_are_met_as_turned_rays_meet_straight_ones() -> None:
    scene = make_scene(SimulateParams())
    crate = scene.objects[1]
    rotation = crate[4:13].reshape(3, 3)
    assert rotation @ rotation.T == pytest.approx(np.eye(3), abs=1e-12)
    flat = scene.heights * 0 - 50.0
    grid = np.array([*scene.grid[:3], -50.0])
    blocks = np.zeros_like(scene.blocks) + np.array([0.0, -50.0])
    for origin, direction in zip(*rays(40, 0.3), strict=True):
        t, which, *normal = nearest_hit(flat, grid, blocks, scene.objects[1:2], *(origin + crate[1:4]), *direction, 2.0)
        expected, *local = hit_box(*(rotation @ origin), *(rotation @ direction), *crate[13:16])
        assert t == pytest.approx(expected)
        assert which == (0 if math.isfinite(expected) else -2)
        assert normal == pytest.approx(list(rotation.T @ local))


def test_shadows_are_where_something_is_between() -> None:
    scene = make_scene(SimulateParams())
    ball = scene.objects[2]
    start = ball[1:4] - np.array([0.0, 0.3, 0.0])
    arrays = scene_arrays(scene)
    assert is_blocked(*arrays, *(ball[1:4] + np.array([0, -0.2, 0.1])), 0.0, 0.9, -0.43588989, 1.0)
    assert not is_blocked(*arrays, *(start + np.array([0.0, 0.0, 0.4])), 0.0, 0.0, 1.0, 1.0)
