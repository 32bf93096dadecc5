from __future__ import annotations

import numpy as np
import pytest
from helpers.pictures import leaves, psnr

from uw_recon_ros.preprocess.wavelet import Pyramid, decompose, noise_sigma, reconstruct, shrink, wavelet_denoise


def noisy(sigma: float, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    clean = leaves(512, 512, seed, count=150)
    return clean, clean + np.random.default_rng(seed + 100).normal(0, sigma, clean.shape).astype(np.float32)


@pytest.mark.parametrize("levels", [1, 3, 6])
def test_pyramid_reconstructs(levels: int) -> None:
    image = np.random.default_rng(0).random((128, 192))
    pyramid = decompose(image, levels)
    assert len(pyramid.bands) == levels
    assert pyramid.lowpass.shape == (128 >> levels, 192 >> levels)
    np.testing.assert_allclose(reconstruct(pyramid), image, rtol=0, atol=1e-12)


@pytest.mark.parametrize("seed", range(3))
def test_white_noise_of_20_gray_levels_is_removed(seed: int) -> None:
    clean, dirty = noisy(20 / 255, seed)
    assert psnr(dirty, clean) == pytest.approx(22.1, abs=0.1)
    assert psnr(wavelet_denoise(dirty), clean) > 29.0


@pytest.mark.parametrize("sigma", [0.01, 0.05, 0.2])
def test_noise_is_estimated(sigma: float) -> None:
    noise = np.random.default_rng(0).normal(0, sigma, (256, 256))
    assert noise_sigma([decompose(noise, 1)]) == pytest.approx(sigma, rel=0.02)


def test_both_cameras_have_one_estimate() -> None:
    rng = np.random.default_rng(0)
    quiet, loud = (decompose(rng.normal(0, sigma, (256, 256)), 1) for sigma in (0.01, 0.03))
    assert noise_sigma([quiet]) < noise_sigma([quiet, loud]) < noise_sigma([loud])
    assert noise_sigma([quiet, loud]) == noise_sigma([loud, quiet])


def test_values_of_equations_7_and_8() -> None:
    rng = np.random.default_rng(0)
    bands = tuple(tuple(rng.normal(0, 1, (size, size)) for _ in range(3)) for size in (16, 8))
    shrunk = shrink(Pyramid(np.zeros((8, 8)), bands), 0.8, window=3)
    for child, parent, result in zip(*bands, shrunk.bands[0], strict=True):
        for v, u in [(5, 5), (8, 3), (14, 1)]:
            sigma_y2 = np.mean(np.square(child[v - 1 : v + 2, u - 1 : u + 2]))
            sigma = np.sqrt(max(sigma_y2 - 0.64, 0))
            radius = np.hypot(child[v, u], parent[v // 2, u // 2])
            threshold = np.sqrt(3) * 0.64 / sigma if sigma > 0 else np.inf
            expected = child[v, u] * max(radius - threshold, 0) / radius
            assert result[v, u] == pytest.approx(expected, abs=1e-12)
    np.testing.assert_array_equal(shrunk.bands[1], bands[1])


def test_no_noise_changes_nothing() -> None:
    image = leaves(64, 64)
    np.testing.assert_allclose(wavelet_denoise(image, sigma=0.0), image, atol=1e-6)
    np.testing.assert_array_equal(wavelet_denoise(np.zeros((64, 64))), np.zeros((64, 64)))


def test_edges_survive() -> None:
    step = np.zeros((128, 128))
    step[:, 64:] = 0.8
    dirty = step + np.random.default_rng(0).normal(0, 0.05, step.shape)
    clean = wavelet_denoise(dirty)
    assert (clean[:, 66].mean() - clean[:, 61].mean()) == pytest.approx(0.8, abs=0.03)
    assert clean[20:100, 20:40].std() < 0.015


def test_is_linear_in_the_unit() -> None:
    _, dirty = noisy(0.05)
    np.testing.assert_allclose(wavelet_denoise(dirty * 8), wavelet_denoise(dirty) * 8, rtol=1e-4, atol=1e-4)


def test_errors_name_what_is_wrong() -> None:
    with pytest.raises(ValueError, match=r"divisible by 2\^3, levels >= 1, got shape \(12, 8\)"):
        decompose(np.zeros((12, 8)), 3)
    with pytest.raises(ValueError, match="levels >= 1"):
        decompose(np.zeros((8, 8)), 0)
    with pytest.raises(ValueError, match=r"sigma: expected a number in .*, got nan"):
        shrink(decompose(np.zeros((8, 8)), 2), float("nan"))
    with pytest.raises(ValueError, match="window: expected an odd number >= 1, got 4"):
        shrink(decompose(np.zeros((8, 8)), 2), 1.0, window=4)


@pytest.mark.parametrize("name", ["sym8", "bior4.4", "rbio2.2"])
def test_other_wavelets_remove_noise_as_well(name: str) -> None:
    clean, dirty = noisy(20 / 255)
    pyramid = decompose(dirty, 5, name)
    assert noise_sigma([decompose(dirty - clean, 1, name)]) == pytest.approx(20 / 255, rel=0.03)
    assert psnr(reconstruct(shrink(pyramid, noise_sigma([pyramid]))), clean) > 28.0
