"""Smooth light amid water is no surface; what has fine texture, or no water around it, is."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from test_planes_matcher import Image, texture, to_bytes

from uw_recon_ros.match.planes import open_water
from uw_recon_ros.match.planes.matcher import graph_cut
from uw_recon_ros.match.planes.smooth_light import smooth_light
from uw_recon_ros.types import Status

Floats = NDArray[np.float32]
HEIGHT, WIDTH, SHIFT = 200, 280, 9
GROUND = np.s_[140:, :]
PATCH = np.s_[45:95, 90:180]
LIGHT, NOISE = 80.0, 0.1


def blob(u0: float, v0: float = 70.0) -> Floats:
    v, u = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    return np.asarray(np.exp(-(((u - u0) / 22) ** 2) - ((v - v0) / 14) ** 2), np.float32)


def views(light: float, fine: float, seed: int = 1) -> tuple[Floats, Floats, Floats]:
    """Brightness, and the derivatives of both views, laid on each other."""
    rng = np.random.default_rng(seed)
    grain = cv2.GaussianBlur(rng.normal(0, 1, (HEIGHT, WIDTH)).astype(np.float32), (0, 0), 0.8)
    brightness = 100 + blob(135) * (light + np.float32(fine) * grain)
    slope = cv2.Sobel(brightness, cv2.CV_32F, 1, 0, ksize=1) / 2
    ours, theirs = (slope + rng.normal(0, np.sqrt(NOISE), slope.shape).astype(np.float32) for _ in range(2))
    return brightness, ours, theirs


@pytest.mark.parametrize(("light", "fine", "amid", "expected"), [
    (LIGHT, 0.0, True, True),
    (LIGHT, 12.0, True, False),  # fine texture in both views is a surface's
    (LIGHT, 0.0, False, False),  # as is what no water surrounds
    (-LIGHT, 0.0, True, False),  # and what is darker than the water
    (0.0, 0.0, True, False),  # nothing there
])  # fmt: skip
def test_what_is_light(light: float, fine: float, amid: bool, expected: bool) -> None:
    brightness, ours, theirs = views(light, fine)
    water = np.full((HEIGHT, WIDTH), amid)
    water[PATCH] = False
    found = smooth_light(brightness, ours, theirs, NOISE, water)
    share = found[60:80, 115:155].mean()
    assert (share > 0.8) if expected else (share < 0.1)
    assert not found[GROUND].any()


def scene(side: int, seed: int) -> Image:
    """A glow at 9 px in a veil above textured ground at the same distance, seen by the left or right camera."""
    rng = np.random.default_rng(10 * seed + side)
    image = np.full((HEIGHT, WIDTH), 80, np.float32) + 90 * blob(140 - SHIFT * side)
    ground = texture(HEIGHT, WIDTH + 40, seed)[..., 0].astype(np.float32)
    image[GROUND] = ground[:, SHIFT * side : SHIFT * side + WIDTH][GROUND]
    noise = cv2.GaussianBlur(rng.normal(0, 1.5, image.shape).astype(np.float32), (0, 0), 1.2)
    return to_bytes(image + noise)


@pytest.mark.parametrize("effort", ["navigation", "balanced"])
def test_a_glow_is_no_surface(effort: str) -> None:
    result = graph_cut(scene(0, 1), scene(1, 1), 0, 30, effort=effort)
    assert np.isfinite(result.disparity[50:90, 100:180]).mean() < 0.05
    assert (result.status[50:90, 100:180] == Status.LOW_TEXTURE).mean() > 0.9
    assert (np.abs(result.disparity[GROUND][8:, 20:] - SHIFT) < 0.5).mean() > 0.97


def test_without_the_rule_the_glow_takes_its_distance(monkeypatch: pytest.MonkeyPatch) -> None:
    """The scene shows what the rule is for."""
    monkeypatch.setattr(open_water, "smooth_light", lambda *a: np.zeros_like(a[-1]))
    claimed = np.isfinite(graph_cut(scene(0, 1), scene(1, 1), 0, 30, effort="navigation").disparity[50:90, 100:180])
    assert claimed.mean() > 0.3


@pytest.mark.parametrize("shape", [(37, 41), (64, 90), (101, 53)])
def test_any_size_is_taken(shape: tuple[int, int]) -> None:
    slope = np.random.default_rng(0).normal(size=shape).astype(np.float32)
    water = np.zeros(shape, np.bool_)
    water[:20] = True
    assert smooth_light(slope, slope, slope, 1.0, water).shape == shape
