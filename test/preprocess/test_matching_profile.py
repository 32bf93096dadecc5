from __future__ import annotations

import numpy as np
import pytest
from helpers.pictures import colored_leaves, leaves, psnr

from uw_recon_ros.preprocess.matching_profile import channel_weights, denoise_evenly, excess_sigma, weighted_gray


def grainy(image: np.ndarray, sigma: float | list[float], seed: int = 0) -> np.ndarray:
    return (image + np.random.default_rng(seed).normal(0, sigma, image.shape)).astype(np.float32)


def test_weights_are_the_best_linear_ones() -> None:
    texture = leaves(200, 300)[..., None] * np.array([0.2, 1.0, 0.5])
    sigmas = np.array([0.05, 0.05, 0.05])
    weights = channel_weights([grainy(texture, sigmas.tolist(), seed) for seed in (0, 1)])
    best = np.array([0.2, 1.0, 0.5]) / sigmas**2
    assert weights == pytest.approx(best / best.sum(), abs=0.05)
    assert weights.sum() == pytest.approx(1)


def test_a_noisy_channel_is_left_out() -> None:
    texture = np.repeat(leaves(200, 300)[..., None], 3, axis=2)
    weights = channel_weights([grainy(texture, [0.2, 0.02, 0.02])])
    assert weights[0] < 0.02
    assert weights[1] == pytest.approx(weights[2], abs=0.05)


def test_weights_without_texture_are_those_of_luminance() -> None:
    assert channel_weights([np.full((20, 20, 3), 0.4)]) == pytest.approx([0.299, 0.587, 0.114])
    assert channel_weights([np.zeros((1, 1, 3))]) == pytest.approx([0.299, 0.587, 0.114])


def test_weighted_gray() -> None:
    image = np.random.default_rng(0).random((6, 5, 3))
    np.testing.assert_allclose(weighted_gray(image, np.array([0.2, 0.5, 0.3])), image @ [0.2, 0.5, 0.3], atol=1e-14)


def test_noise_of_one_gray_level_is_none() -> None:
    flat = np.full((128, 128), 0.5)
    assert excess_sigma([grainy(flat, 0.8 / 255)]) == 0.0
    assert excess_sigma([grainy(flat, 10 / 255)]) == pytest.approx(10 / 255, rel=0.05)


@pytest.mark.parametrize("shape", [(1, 1), (5, 300), (97, 61), (256, 256)])
def test_denoising_keeps_any_size(shape: tuple[int, int]) -> None:
    image = grainy(np.full(shape, 0.5), 0.05)
    denoised = denoise_evenly(image, 0.05)
    assert denoised.shape == shape
    assert denoised.dtype == np.float32
    assert denoised.mean() == pytest.approx(image.mean(), abs=0.02)


def test_denoising_removes_noise_and_leaves_a_clean_picture() -> None:
    clean = leaves(240, 320, count=150)
    assert psnr(denoise_evenly(grainy(clean, 20 / 255), 20 / 255), clean) > 28.5
    assert denoise_evenly(clean, 0.0) is clean


def test_denoising_depends_less_on_the_place_than_one_decomposition() -> None:
    from uw_recon_ros.preprocess.wavelet import wavelet_denoise

    image = grainy(leaves(256, 256), 0.05)
    moved = np.roll(image, (1, 1), (0, 1))
    inner = np.s_[32:-32, 32:-32]

    def change(denoise: object) -> float:
        return float(np.std((np.roll(denoise(moved), (-1, -1), (0, 1)) - denoise(image))[inner]))  # type: ignore[operator]

    assert change(lambda x: denoise_evenly(x, 0.05)) < 0.7 * change(lambda x: wavelet_denoise(x, 4, 0.05))


def test_errors_name_what_is_wrong() -> None:
    with pytest.raises(ValueError, match="images: expected at least one, got none"):
        channel_weights([])
    with pytest.raises(ValueError, match=r"images: expected shape \(H, W, 3\)"):
        channel_weights([np.zeros((4, 4))])
    with pytest.raises(ValueError, match="sigma: expected a number"):
        denoise_evenly(np.zeros((4, 4)), -1.0)
    with pytest.raises(TypeError, match="image: expected float32 or float64, got uint8"):
        weighted_gray(np.zeros((4, 4, 3), np.uint8), np.ones(3))


def test_a_cast_shifts_the_weights_to_the_channels_that_tell() -> None:
    image = grainy(colored_leaves(200, 300), 0.02)
    weights = channel_weights([image])
    assert weights[0] < min(weights[1], weights[2])
