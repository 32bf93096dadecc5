from __future__ import annotations

import numpy as np
import pytest
from helpers.pictures import colored_leaves
from hypothesis import given, settings
from hypothesis import strategies as st

from uw_recon_ros.preprocess.color import (
    apply_gains,
    equalizing_gains,
    luminance,
    replace_luminance,
    rgb_from_ycbcr,
    ycbcr_from_rgb,
)


@pytest.mark.parametrize(("dtype", "tolerance"), [(np.float32, 1e-6), (np.float64, 1e-14)])
def test_round_trip(dtype: type, tolerance: float) -> None:
    rgb = np.random.default_rng(0).random((40, 50, 3)).astype(dtype)
    ycbcr = ycbcr_from_rgb(rgb)
    assert ycbcr.dtype == dtype
    np.testing.assert_allclose(rgb_from_ycbcr(ycbcr), rgb, rtol=0, atol=tolerance)


@pytest.mark.parametrize(
    ("rgb", "ycbcr"),
    [
        ((1, 0, 0), (0.299, -0.168736, 0.5)),
        ((0, 1, 0), (0.587, -0.331264, -0.418688)),
        ((0, 0, 1), (0.114, 0.5, -0.081312)),
        ((0.25, 0.25, 0.25), (0.25, 0, 0)),
    ],
)
def test_values_of_the_standard(rgb: tuple[float, ...], ycbcr: tuple[float, ...]) -> None:
    image = np.array(rgb, np.float64).reshape(1, 1, 3)
    np.testing.assert_allclose(ycbcr_from_rgb(image).ravel(), ycbcr, atol=1e-6)
    assert luminance(image)[0, 0] == pytest.approx(ycbcr[0])


def test_mono_is_its_own_luminance() -> None:
    gray = np.random.default_rng(0).random((5, 7))
    np.testing.assert_array_equal(luminance(gray), gray)


def test_chroma_that_follows_keeps_the_ratios_of_the_channels() -> None:
    rgb = colored_leaves(60, 80).astype(np.float64) * 0.5 + 0.05
    ycbcr = ycbcr_from_rgb(rgb)
    changed = rgb_from_ycbcr(replace_luminance(ycbcr, ycbcr[..., 0] * 1.7))
    np.testing.assert_allclose(changed, rgb * 1.7, atol=1e-12)


@pytest.mark.parametrize(("brightened", "chroma"), [(4.0, 4.0), (8.0, 8.0), (20.0, 8.0)])
def test_chroma_grows_eightfold_at_most(brightened: float, chroma: float) -> None:
    """A dark pixel's colour is mostly noise."""
    ycbcr = np.array([[[0.04, 0.01, -0.02]]])
    replaced = replace_luminance(ycbcr, np.array([[0.04 * brightened]]))
    np.testing.assert_allclose(replaced[0, 0], [0.04 * brightened, 0.01 * chroma, -0.02 * chroma])


def test_chroma_that_stays_stays() -> None:
    ycbcr = ycbcr_from_rgb(colored_leaves(60, 80))
    replaced = replace_luminance(ycbcr, np.full((60, 80), 0.5, np.float32), chroma_follows=False)
    assert np.all(replaced[..., 0] == 0.5)
    np.testing.assert_array_equal(replaced[..., 1:], ycbcr[..., 1:])


def test_black_pixels_stay_finite_when_brightened() -> None:
    replaced = replace_luminance(np.zeros((4, 4, 3)), np.ones((4, 4)))
    np.testing.assert_array_equal(rgb_from_ycbcr(replaced), np.ones((4, 4, 3)))
    np.testing.assert_array_equal(replace_luminance(np.zeros((4, 4, 3)), np.zeros((4, 4))), np.zeros((4, 4, 3)))


@settings(max_examples=25)
@given(st.integers(0, 1000), st.floats(0.15, 1.0), st.floats(0.15, 1.0))
def test_means_of_both_cameras_together_become_equal(seed: int, red: float, blue: float) -> None:
    rng = np.random.default_rng(seed)
    views = [np.clip(rng.random((40, 60, 3)) * level, 0, None) * [red, 1.0, blue] for level in (0.6, 1.3)]
    gains = equalizing_gains(views)
    balanced = np.stack([apply_gains(view, gains) for view in views])
    means = balanced.mean(axis=(0, 1, 2))
    assert np.ptp(means) < 2e-3
    assert means.mean() == pytest.approx(np.clip(views, 0, 1).mean(), abs=2e-3)
    assert balanced.max() <= 1.0


def test_both_cameras_get_the_same_gain() -> None:
    left = colored_leaves(60, 80, 0)
    right = colored_leaves(60, 80, 5) * np.float32(0.5)
    gains = equalizing_gains([left, right])
    means = [apply_gains(view, gains).mean() for view in (left, right)]
    assert means[1] / means[0] == pytest.approx(right.mean() / left.mean(), rel=0.1)


def test_a_missing_channel_is_not_blown_up_without_limit() -> None:
    gone = np.full((20, 20, 3), [0.001, 0.4, 0.5])
    assert equalizing_gains([gone], max_gain=4.0)[0] == 4.0
    assert equalizing_gains([np.zeros((20, 20, 3))]) == pytest.approx([1, 1, 1])


def test_errors_name_what_is_wrong() -> None:
    with pytest.raises(ValueError, match=r"rgb: expected shape \(H, W, 3\).*got \(4, 4\)"):
        ycbcr_from_rgb(np.zeros((4, 4)))
    with pytest.raises(ValueError, match=r"ycbcr: expected finite values, got 48 NaN"):
        rgb_from_ycbcr(np.full((4, 4, 3), np.nan))
    with pytest.raises(ValueError, match=r"luminance: expected shape \(4, 4\), as ycbcr, got \(4, 5\)"):
        replace_luminance(np.zeros((4, 4, 3)), np.zeros((4, 5)))
    with pytest.raises(ValueError, match="images: expected at least one, got none"):
        equalizing_gains([])
    with pytest.raises(ValueError, match=r"max_gain: expected a number in \[1, inf\], got 0.5"):
        equalizing_gains([np.zeros((4, 4, 3))], max_gain=0.5)
