"""Sigma of a matched disparity: against errors that are known, and what it must not depend on."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from uw_recon_ros.match.planes.disparity_sigma import MOST, plain_gray, sigma_of, with_disagreement
from uw_recon_ros.match.planes.matcher import graph_cut

H, W = 120, 200
RANGE = 5, 25
V, U = np.indices((H, W), dtype=np.float32)
TRUTH = 12 + 0.02 * U - 0.015 * V + 2 * np.sin(U / 25) * np.cos(V / 31)


def views(noise: float, contrast: float = 30.0, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """A curved wall of disparity `TRUTH`, seen by both cameras, each with noise of its own."""
    rng = np.random.default_rng(seed)
    wide = cv2.GaussianBlur(rng.normal(size=(H, 8 * (W + 60))).astype(np.float32), (0, 0), 9.6, sigmaY=1.2)
    wide *= contrast / wide.std()
    in_right = np.stack([np.interp(np.arange(W), u - d, u) for u, d in zip(U, TRUTH, strict=True)])

    def seen(columns: np.ndarray) -> np.ndarray:
        image = cv2.remap(wide, (8 * columns).astype(np.float32), V, cv2.INTER_LINEAR) + rng.normal(0, noise, (H, W))
        return np.clip(np.rint(image + 128), 0, 255).astype(np.uint8)

    return seen(U), seen(in_right)


def sigma_at(
    left: np.ndarray, right: np.ndarray, disparity: np.ndarray | float, effort: str = "balanced"
) -> np.ndarray:
    grays = plain_gray(left[..., None], 0.0), plain_gray(right[..., None], 0.0)
    disparity = np.broadcast_to(np.float32(disparity), left.shape).astype(np.float32)
    return sigma_of(*grays, disparity, np.zeros(left.shape, np.uint8), effort)


@pytest.mark.parametrize("noise", [1.0, 4.0, 8.0])
@pytest.mark.parametrize("effort", ["navigation", "balanced"])
def test_sigma_is_as_large_as_the_errors(noise: float, effort: str) -> None:
    """From a fortieth of a pixel to a fifth; a smooth wall is kinder to the matcher than a dive."""
    result = graph_cut(*views(noise), *RANGE, effort=effort)
    error = np.abs(result.disparity - TRUTH)
    known = np.isfinite(error)
    assert known.mean() > 0.85
    assert 0.6 < np.median(result.sigma[known]) / np.quantile(error[known], 0.68) < 2.2


def test_more_noise_and_less_contrast_are_less_sure() -> None:
    clear, noisy = views(2.0), views(8.0)
    faint = views(2.0, contrast=8.0)
    sure, unsure, vague = (np.median(sigma_at(*pair, TRUTH)) for pair in (clear, noisy, faint))
    assert 2.0 < unsure / sure < 5.0  # four times the noise; what interpolation costs stays
    assert 2.0 < vague / sure < 5.0


def test_gain_and_offset_common_to_both_cameras_change_nothing() -> None:
    left, right = views(2.0, contrast=20.0)
    darker = [np.clip(np.rint(image * 0.5 + 20), 0, 255).astype(np.uint8) for image in (left, right)]
    one, other = np.median(sigma_at(left, right, TRUTH)), np.median(sigma_at(*darker, TRUTH))
    assert other == pytest.approx(one, rel=0.15)  # but for rounding


def test_a_wrong_match_is_not_sure() -> None:
    left, right = views(2.0)
    assert np.median(sigma_at(left, right, TRUTH + 5)) > 5 * np.median(sigma_at(left, right, TRUTH))


def test_nothing_to_see_is_as_unsure_as_can_be_said() -> None:
    blank = np.full((H, W), 90, np.uint8)
    assert (sigma_at(blank, blank, 8.0) <= MOST).all()
    noise = np.random.default_rng(1).integers(80, 84, (2, H, W)).astype(np.uint8)
    assert np.median(sigma_at(noise[0], noise[1], 8.0)) > 0.25


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (3, 2), (20, 4)])
def test_tiny_images(shape: tuple[int, int]) -> None:
    image = np.random.default_rng(0).integers(0, 256, shape).astype(np.uint8)
    sigma = sigma_at(image, image, 0.0)
    assert sigma.shape == shape
    assert ((sigma > 0) & (sigma <= MOST)).all()


def test_the_number_of_threads_changes_no_bit() -> None:
    left, right = views(3.0)
    grays = plain_gray(left[..., None], 0.0), plain_gray(right[..., None], 0.0)
    disparity = TRUTH.copy()
    status = (np.random.default_rng(0).random((H, W)) < 0.3).astype(np.uint8)
    disparity[status > 0] = np.nan
    one, three = (sigma_of(*grays, disparity, status, "balanced", threads)[status == 0] for threads in (1, 3))
    assert one.tobytes() == three.tobytes()
    assert np.isfinite(one).all()


def test_where_the_start_says_something_else_planes_are_less_sure() -> None:
    """By what its mean disagreement exceeds its own noise, where both views agree on a comparable start."""
    shape = 30, 40
    sigma, disparity = np.full(shape, 0.1, np.float32), np.full(shape, 20.0, np.float32)
    start, agreed = disparity.copy(), np.ones(shape, np.bool_)
    start[10:20, 10:20] += 0.8
    smaller = with_disagreement(sigma, disparity, start, agreed)
    assert smaller[15, 15] == pytest.approx(np.sqrt(0.01 + 0.64 - 0.0225), rel=1e-4)
    assert (smaller[:5] == sigma[:5]).all()
    assert (with_disagreement(sigma, disparity, start, ~agreed) == sigma).all()
    assert (with_disagreement(sigma, disparity, disparity + 3, agreed) == sigma).all()
    noise = np.random.default_rng(1).normal(0, 0.1, shape).astype(np.float32)
    assert (with_disagreement(sigma, disparity, disparity + noise, agreed) == sigma).mean() > 0.95
    disparity[0, 0] = sigma[0, 0] = np.nan
    lost = with_disagreement(sigma, disparity, start, agreed)
    assert np.isnan(lost[0, 0])
    assert np.isfinite(lost).sum() == lost.size - 1
