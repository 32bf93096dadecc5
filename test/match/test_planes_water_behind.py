"""Even water beside a thing is no surface at the thing's distance; faint ground is no water."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from test_planes_matcher import Image, texture, to_bytes

from uw_recon_ros.match.planes import open_water
from uw_recon_ros.match.planes.matcher import graph_cut
from uw_recon_ros.match.planes.water_behind import water_behind
from uw_recon_ros.types import Status

HEIGHT, WIDTH, SHIFT = 180, 280, 9
HULL, MAST = np.s_[110:180, 60:230], np.s_[20:110, 190:204]
BESIDE = np.s_[40:95, 120:175]  #: of the water, between what stands there
GRAIN = 1.2  #: px: what enhancing leaves of noise is smooth


def smooth_noise(rng: np.random.Generator, sigma: float) -> NDArray[np.float32]:
    return cv2.GaussianBlur(rng.normal(0, sigma, (HEIGHT, WIDTH)).astype(np.float32), (0, 0), GRAIN)


def wreck(side: int, seed: int) -> Image:
    """A textured hull and mast at 9 px before a veil, as the left or right camera sees it."""
    rng = np.random.default_rng(10 * seed + side)
    image = np.repeat(np.linspace(120, 90, HEIGHT, dtype=np.float32)[:, None], WIDTH, 1) + smooth_noise(rng, 1.5)
    iron = texture(HEIGHT, WIDTH + 40, seed)[..., 0].astype(np.float32)
    for rows, columns in (HULL, MAST):
        here = slice(columns.start - SHIFT * side, columns.stop - SHIFT * side)
        image[rows, here] = iron[rows, columns] + smooth_noise(rng, 1.5)[rows, here]
    return to_bytes(image)


@pytest.mark.parametrize("effort", ["navigation", "balanced"])
@pytest.mark.parametrize("seed", [1, 2])
def test_water_beside_a_thing_is_no_surface(effort: str, seed: int) -> None:
    result = graph_cut(wreck(0, seed), wreck(1, seed), 0, 30, effort=effort)
    assert np.isfinite(result.disparity[BESIDE]).mean() < 0.05
    assert (result.status[BESIDE] == Status.LOW_TEXTURE).mean() > 0.9
    hull = result.disparity[HULL][8:-8, 20:-8]
    assert (np.abs(hull - SHIFT) < 0.5).mean() > 0.97


def test_without_the_rule_the_water_takes_the_things_depth(monkeypatch: pytest.MonkeyPatch) -> None:
    """The scene shows what the rule is for."""
    monkeypatch.setattr(open_water, "water_behind", lambda *a: np.zeros_like(a[-1]))
    claimed = np.isfinite(graph_cut(wreck(0, 1), wreck(1, 1), 0, 30, effort="navigation").disparity[BESIDE])
    assert claimed.mean() > 0.3


def slopes(alike: float, seed: int = 3) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Derivatives of two views: strong texture below, faint above, of which a part is the same in both."""
    rng = np.random.default_rng(seed)
    common, *own = (cv2.GaussianBlur(smooth_noise(rng, 1), (0, 0), 0.8) for _ in range(3))
    own = [np.sqrt(alike) * common + np.sqrt(1 - alike) * noise for noise in own]
    for view in own:
        view[HEIGHT // 2 :] = 60 * common[HEIGHT // 2 :]
    return own[0], own[1]


@pytest.mark.parametrize(("alike", "light", "sure", "expected"), [
    (0.0, 0.0, 0.5, True),
    (0.8, 0.0, 0.5, False),  # what both views show is a surface
    (0.0, 40.0, 0.5, False),  # as is what is of another brightness
    (0.0, 0.0, 0.0, False),  # and what has no water beside it
    (0.0, 0.0, 0.02, False),  # or hardly any
])  # fmt: skip
def test_what_is_water(alike: float, light: float, sure: float, expected: bool) -> None:
    ours, theirs = slopes(alike)
    noise = float(ours[: HEIGHT // 2].var())
    water = np.zeros((HEIGHT, WIDTH), np.bool_)
    edge = int(sure * WIDTH)
    water[: HEIGHT // 2, :edge] = True
    brightness = np.full((HEIGHT, WIDTH), 100, np.float32)
    brightness[:, edge:] += np.float32(light)
    found = water_behind(brightness, ours, theirs, np.zeros((HEIGHT, WIDTH), np.float32), noise, water)
    share = found[10 : HEIGHT // 2 - 10, edge + 25 : edge + 100].mean()
    assert (share > 0.9) if expected else (share < 0.1)
    assert not found[HEIGHT // 2 + 8 :].any()


@pytest.mark.parametrize("shape", [(37, 41), (64, 90), (101, 53)])
def test_any_size_is_taken(shape: tuple[int, int]) -> None:
    slope = np.random.default_rng(0).normal(size=shape).astype(np.float32)
    sure = np.zeros(shape, np.bool_)
    sure[:20] = True
    assert water_behind(slope, slope, slope, slope * 0, 1.0, sure).shape == shape
