"""Nothing is claimed where nothing can be seen: blank patches under noise, empty walls, lamps that saturate."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from test_match_stage import GEOMETRY
from test_planes_matcher import Image, pair_of, texture, to_bytes

from uw_recon_ros.match.methods import EFFORTS
from uw_recon_ros.match.planes import refinement
from uw_recon_ros.match.planes.matcher import graph_cut
from uw_recon_ros.match.planes.texture import Texture, derivative, local_variance, noise_sigma, untextured_mask
from uw_recon_ros.match.stage import Match, MatchParams
from uw_recon_ros.types import RectificationQuality, RectifiedPair, Status

PATCH = np.s_[30:90, 60:130]
SHIFT = 6


def noisy(image: NDArray[np.floating] | Image, sigma: float, seed: int) -> Image:
    return to_bytes(image + np.random.RandomState(seed).normal(0, sigma, image.shape))


def blank_patch(sigma: float, color: bool = False) -> tuple[Image, Image]:
    """A textured wall at 6 px with a patch without any texture, noise of its own in either camera."""
    left, right = (image.astype(np.float32) for image in pair_of(np.full((120, 180), float(SHIFT))))
    left[PATCH] = 110
    right[PATCH[0], PATCH[1].start - SHIFT : PATCH[1].stop - SHIFT] = 110
    pair = noisy(left, sigma, 1), noisy(right, sigma, 2)
    return pair if color else (pair[0][..., 1].copy(), pair[1][..., 1].copy())


def inside(by: int) -> tuple[slice, slice]:
    rows, columns = PATCH
    return slice(rows.start + by, rows.stop - by), slice(columns.start + by, columns.stop - by)


@pytest.mark.parametrize("effort", EFFORTS)
@pytest.mark.parametrize(("sigma", "color"), [(0.0, False), (1.0, True), (4.0, False), (8.0, True)])
def test_blank_patch_is_told_from_the_wall_around_it(effort: str, sigma: float, color: bool) -> None:
    result = graph_cut(*blank_patch(sigma, color), 0, 20, effort=effort)
    low = result.status == Status.LOW_TEXTURE
    assert low[inside(13)].mean() > 0.95
    outside = np.ones(low.shape, bool)
    outside[inside(0)] = False
    assert not low[outside].any()
    outside[:, :SHIFT] = False
    outside[inside(-5)] = False
    assert (np.abs(result.disparity - SHIFT) < 0.5)[outside].mean() > 0.95
    assert not np.isfinite(result.disparity[low]).any()


@pytest.mark.parametrize("sigma", [0.0, 3.0, 25.0])
@pytest.mark.parametrize("effort", EFFORTS)
def test_open_water_claims_nothing(effort: str, sigma: float) -> None:
    left, right = (noisy(np.full((90, 140), 77.0), sigma, seed) for seed in (3, 4))
    result = graph_cut(left, right, 0, 20, effort=effort)
    assert (np.isfinite(result.disparity)).mean() < 0.02
    assert (result.status == Status.LOW_TEXTURE).mean() > 0.8  # the rest lies outside the other view


def test_saturated_lamp_claims_nothing() -> None:
    left, right = (image.copy() for image in pair_of(np.full((120, 180), float(SHIFT))))
    left[PATCH] = 255
    right[PATCH[0], PATCH[1].start - SHIFT : PATCH[1].stop - SHIFT] = 255
    assert (graph_cut(left, right, 0, 20).status[inside(15)] == Status.LOW_TEXTURE).all()


@pytest.mark.parametrize("shape", [(120, 160), (15, 300), (300, 15), (43, 47)])
def test_noise_alone_is_hardly_ever_taken_for_texture(shape: tuple[int, int]) -> None:
    shares = []
    for seed in range(20):
        sides = [noisy(np.full(shape, 120.0), 4.0, 2 * seed + side)[..., None] for side in (0, 1)]
        shares.append(untextured_mask(Texture(*sides)).mean())
    assert np.mean(shares) > 0.9


def test_stripes_along_the_rows_tell_no_disparity() -> None:
    rows = np.repeat(texture(120, 1, 5)[..., 0], 180, axis=1)
    left, right = (noisy(rows, 2.0, seed)[..., None] for seed in (1, 2))
    assert untextured_mask(Texture(left, right)).mean() > 0.9
    upright = [np.ascontiguousarray(image.swapaxes(0, 1)) for image in (left, right)]
    assert untextured_mask(Texture(*upright)).mean() < 0.02


def test_the_noisier_camera_decides() -> None:
    faint = 100 + (texture(120, 160, 2) - 128) / 15
    left = noisy(faint, 0.5, 1)
    assert untextured_mask(Texture(left, noisy(faint, 0.5, 2))).mean() < 0.05
    assert untextured_mask(Texture(left, noisy(faint, 10.0, 2))).mean() > 0.6


@pytest.mark.parametrize("sigma", [1.0, 3.0, 12.0])
def test_noise_is_measured_beside_texture(sigma: float) -> None:
    scene = np.full((200, 300), 120.0)
    scene[:, 120:] = texture(200, 180, 3)[..., 0]
    assert noise_sigma(noisy(scene, sigma, 1).astype(np.float32)) == pytest.approx(sigma, rel=0.15)


def test_a_veil_that_brightens_evenly_is_no_texture() -> None:
    ramp = np.tile(np.arange(80, dtype=np.float32) * 1.5, (40, 1))
    assert np.allclose(derivative(ramp)[2:-2, 12:-12], 1.5, rtol=1e-3)
    assert (local_variance(derivative(ramp))[:, 12:-12] < 1e-6).all()


def test_variance_of_a_wave_is_that_of_its_slope() -> None:
    wave = np.tile(20 * np.sin(np.arange(150, dtype=np.float32) * 2 * np.pi / 15), (40, 1)).astype(np.float32)
    slope = np.cos(2 * np.pi / 15 * np.arange(15)) * 20 * np.sin(2 * np.pi / 15) * np.exp(-((2 * np.pi / 15) ** 2) / 2)
    assert local_variance(derivative(wave))[20, 75] == pytest.approx(slope.var(), rel=0.02)


def enhanced_water(side: int, contrast: float, seed: int = 0) -> NDArray[np.float32]:
    """The right half is a wall at `SHIFT` px, the left a veil that brightens; noise that a filter has made smooth."""
    rng = np.random.default_rng([seed, side])
    veil = np.tile(np.linspace(60, 140, 240, dtype=np.float32), (140, 1))
    wall = texture(140, 320, 4)[:, :, 0].astype(np.float32)[:, 20 + SHIFT * side : 260 + SHIFT * side]
    wall = (wall - wall.mean()) * contrast / wall.std()
    edge = 120 - SHIFT * side
    noise = cv2.GaussianBlur(rng.normal(0, 6, veil.shape).astype(np.float32), (0, 0), 1.2)
    veil[:, edge:] += wall[:, edge:]
    return veil + noise


@pytest.mark.parametrize("effort", ["navigation", "balanced"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_smooth_noise_in_a_veil_is_no_surface(effort: str, seed: int) -> None:
    left, right = (to_bytes(enhanced_water(side, 25, seed)) for side in (0, 1))
    result = graph_cut(left, right, 0, 40, effort=effort)
    assert np.isfinite(result.disparity)[:, 40:95].mean() < 0.05
    assert (result.status == Status.LOW_TEXTURE)[:, 40:95].mean() > 0.9
    wall = result.disparity[:, 140:235]
    assert (np.abs(wall - SHIFT) < 0.5).mean() > 0.97


def test_what_is_faint_but_of_one_piece_is_kept() -> None:
    """As mud is: its texture not stronger than the noise, which is as smooth, its surface one."""
    left, right = (to_bytes(enhanced_water(side, 2.5)) for side in (0, 1))
    found = graph_cut(left, right, 0, 40).disparity[:, 145:230]
    assert np.isfinite(found).mean() > 0.9
    assert np.nanmean(np.abs(found - SHIFT) < 1) > 0.95


def test_nothing_is_cut_in_open_water(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[int] = []
    real = refinement.run_tiles
    monkeypatch.setattr(refinement, "run_tiles", lambda tiles, way, planes, cut, *a: (
        tried.append(len(tiles)) if cut else None, real(tiles, way, planes, cut, *a))[1])  # fmt: skip
    left, right = (noisy(np.full((120, 180), 77.0), 3.0, seed) for seed in (3, 4))
    graph_cut(left, right, 0, 20)
    water = sum(tried)
    tried.clear()
    graph_cut(*pair_of(np.full((120, 180), float(SHIFT))), 0, 20)
    assert water <= 0.1 * sum(tried)


@pytest.mark.parametrize("axis", ["horizontal", "vertical"])
def test_stage_hands_the_reason_on(axis: str) -> None:
    left, right = (i if axis == "horizontal" else i.T.copy() for i in blank_patch(4.0))
    shown = np.zeros((*left.shape, 3), np.uint8)
    geometry = dataclasses.replace(GEOMETRY, axis=axis)
    pair = RectifiedPair(shown, shown, left, right, geometry, RectificationQuality("given"))
    result = Match(MatchParams(max_disparity=20))(pair)
    status = result.status if axis == "horizontal" else result.status.T
    assert (status[inside(13)] == Status.LOW_TEXTURE).mean() > 0.95
    assert np.array_equal(np.isfinite(result.disparity), result.status == 0)
