"""Parts of a pixel: a flattened relief is found again, and nothing is invented where images say nothing."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from uw_recon_ros.match.subpixel import refine_below_a_pixel

H, W = 160, 240


def scene(noise: float = 0.0, seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Left and right view, and disparities of the left: waves of 1.5 px about 20 px, over paint."""
    rng = np.random.default_rng(seed)
    paint = cv2.GaussianBlur(rng.normal(size=(H, 2 * W)).astype(np.float32), (0, 0), 1.2)
    paint = 120 + 40 * paint / paint.std()
    v, u = np.mgrid[:H, :W].astype(np.float32)
    true = (20 + 1.5 * np.sin(u / 25) * np.cos(v / 30)).astype(np.float32)
    right = paint[:, 40 : 40 + W]
    left = cv2.remap(paint, 40 + u - true, v, cv2.INTER_CUBIC)
    views = [image + noise * rng.normal(size=image.shape) for image in (left, right)]
    return *(np.clip(np.rint(x), 1, 255).astype(np.uint8) for x in views), true


def sure(true: np.ndarray, sigma: float = 0.15) -> np.ndarray:
    return np.full_like(true, sigma)


@pytest.mark.parametrize("factor", [1.0, 0.7])
def test_a_flattened_relief_is_found_again(factor: float) -> None:
    """Whatever the brightness of the other view."""
    left, right, true = scene(noise=2.0)
    right = np.clip(np.rint(right * factor), 1, 255).astype(np.uint8) if factor != 1.0 else right
    left = np.clip(np.rint(left * factor + 20), 1, 255).astype(np.uint8)
    flattened = (20 + 0.9 * (true - 20)).astype(np.float32)
    found, _ = refine_below_a_pixel(left, right, flattened, sure(true))
    inner = np.s_[20:-20, 50:-20]
    slope = [np.polyfit((true[inner] - 20).ravel(), (x - true)[inner].ravel(), 1)[0] for x in (flattened, found)]
    assert abs(slope[1]) < 0.25 * abs(slope[0])
    assert np.abs(found - true)[inner].mean() < 0.5 * np.abs(flattened - true)[inner].mean()


def test_views_without_anything_change_nothing() -> None:
    true = scene()[2]
    plain = np.full((H, W), 90, np.uint8)
    for told in (0.15, 1.0):
        found, sigma = refine_below_a_pixel(plain, plain, true, sure(true, told))
        np.testing.assert_array_equal(found, true)
        np.testing.assert_array_equal(sigma, sure(true, told))


def test_noise_alone_moves_less_than_the_disparities_are_unsure_of() -> None:
    rng = np.random.default_rng(2)
    left, right = rng.integers(60, 120, (2, H, W)).astype(np.uint8)
    true = scene()[2]
    found, _ = refine_below_a_pixel(left, right, true, sure(true))
    assert np.sqrt(((found - true) ** 2).mean()) < 0.5 * 0.15


def test_what_is_not_seen_and_not_known_stays() -> None:
    left, right, true = scene(noise=2.0)
    off = true + np.float32(0.2)
    off[40:60, 100:140] = np.nan
    right[:, 100:160] = 0
    found, sigma = refine_below_a_pixel(left, right, off, sure(true))
    np.testing.assert_array_equal(np.isnan(found), np.isnan(off))
    u = np.arange(W)[None, :] - off
    lost = (u > 104) & (u < 155)
    np.testing.assert_array_equal(found[lost], off[lost])
    np.testing.assert_array_equal(sigma[lost & np.isfinite(off)], np.float32(0.15))
    np.testing.assert_array_equal(found[:, :19], off[:, :19])  # beside the right view
    assert np.nanmedian(np.abs(found - true)[20:-20, 200:-10]) < 0.1
    everything = np.full_like(true, np.nan)
    for image in refine_below_a_pixel(left, right, everything, everything):
        np.testing.assert_array_equal(image, everything)


@pytest.mark.parametrize("noise", [2.0, 6.0])
def test_sigma_holds_what_is_left(noise: float) -> None:
    """Whatever was said before, as long as it was not too little."""
    left, right, true = scene(noise=noise)
    rng = np.random.default_rng(4)
    off = true + cv2.GaussianBlur(rng.normal(size=true.shape), (0, 0), 12.0) * 0.15 * 42
    inner = np.s_[20:-20, 50:-20]
    for told in (0.15, 0.3):
        found, sigma = refine_below_a_pixel(left, right, off.astype(np.float32), sure(true, told))
        missed = np.abs(found - true)[inner]
        assert np.median(sigma[inner]) < 0.8 * told
        assert (missed <= sigma[inner]).mean() > 0.55
        assert (missed <= 2 * sigma[inner]).mean() > 0.85


def test_less_texture_is_less_sure() -> None:
    left, right, true = scene(noise=2.0)
    faint = [np.clip(np.rint(120 + 0.3 * (x.astype(float) - 120)), 1, 255).astype(np.uint8) for x in (left, right)]
    rng = np.random.default_rng(3)
    faint = [np.clip(np.rint(x + 2.0 * rng.normal(size=x.shape)), 1, 255).astype(np.uint8) for x in faint]
    sigmas = [np.median(refine_below_a_pixel(*views, true, sure(true))[1]) for views in ((left, right), faint)]
    assert sigmas[0] < sigmas[1] <= 0.15
