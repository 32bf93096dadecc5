"""Fish: slender bodies that swim before the scene, to and fro across the view."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from uw_recon_ros.simulate.rig import Pose
from uw_recon_ros.simulate.scene import AMPHORA, METAL, Scene, solid

_LENGTH_M, _RADIUS_M = 0.22, 0.035
_NEAR, _FAR = 0.45, 0.9  # of the distance to the scene
_WAY_M, _SPEED_M_S = 1.6, 0.35


def with_fish(scene: Scene, count: int, seed: int, pose: Pose, distance_m: float, seconds: float) -> Scene:
    """The scene with `count` fish as they are at a time.

    Parameters
    ----------
    scene : Scene
    count, seed : int
    pose : Pose
        Of the left optical frame when the first pair was taken: they swim before that.
    distance_m : float
        To the scene.
    seconds : float
        Since then.
    """
    if not count:
        return scene
    rng = np.random.default_rng([seed, 9])
    found = [_one(rng, pose, distance_m, seconds) for _ in range(count)]
    return replace(scene, objects=np.concatenate([scene.objects, np.array(found, np.float64)]))


def _one(rng: np.random.Generator, pose: Pose, distance_m: float, seconds: float) -> list[float]:
    away, up, start, speed = rng.uniform([_NEAR, -0.3, 0.0, 0.6], [_FAR, 0.25, 2.0, 1.4])
    way = (start * _WAY_M + speed * _SPEED_M_S * seconds) % (2 * _WAY_M)
    along = _WAY_M - abs(way - _WAY_M) - _WAY_M / 2
    depth = away * distance_m
    place = pose.position + pose.rotation @ np.array([along, up * depth, depth])
    wag = 12.0 * float(np.sin(9.0 * seconds + 6.0 * start))
    x, y, z = (float(c) for c in place)
    return solid(AMPHORA, (x, y, z), (0.0, 90.0, wag), (_LENGTH_M, _RADIUS_M, 0.0), METAL)
