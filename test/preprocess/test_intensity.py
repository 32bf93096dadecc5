from __future__ import annotations

import numpy as np
import pytest

from uw_recon_ros.preprocess.intensity import intensity_bounds, joint_percentiles, stretch


def test_bounds_are_percentiles_of_both_cameras_together() -> None:
    rng = np.random.default_rng(0)
    left, right = rng.random((50, 60)), 2 + rng.random((50, 60))
    expected = np.percentile(np.concatenate([left.ravel(), right.ravel()]), [2, 98])
    assert intensity_bounds([left, right], 2.0) == pytest.approx(tuple(expected))


def test_large_images_are_sampled_closely_enough() -> None:
    image = np.random.default_rng(0).random((1500, 1700)).astype(np.float32)
    assert joint_percentiles([image], [1, 50, 99]) == pytest.approx([0.01, 0.5, 0.99], abs=5e-3)


def test_stretch_uses_the_whole_range_and_saturates_what_was_asked() -> None:
    image = np.random.default_rng(0).normal(5, 1, (200, 200))
    stretched = stretch(image, intensity_bounds([image], 1.0))
    assert stretched.min() == 0.0
    assert stretched.max() == 1.0
    assert np.mean(stretched == 0) == pytest.approx(0.01, abs=1e-3)
    assert np.mean(stretched == 1) == pytest.approx(0.01, abs=1e-3)


def test_equal_pixels_of_both_cameras_stay_equal() -> None:
    rng = np.random.default_rng(0)
    left = rng.random((40, 40))
    right = np.roll(left, -5, axis=1)
    right[:, -5:] = 4.0  # seen by the right camera alone
    bounds = intensity_bounds([left, right], 1.0)
    np.testing.assert_array_equal(stretch(left, bounds)[:, 5:], stretch(right, bounds)[:, :-5])


def test_blank_images_become_gray_not_noise() -> None:
    blank = 0.7 + np.random.default_rng(0).normal(0, 1e-6, (20, 20))
    assert np.all(stretch(blank, intensity_bounds([blank])) == 0.5)


def test_float32_stays_float32() -> None:
    assert stretch(np.eye(4, dtype=np.float32), (0.0, 2.0)).dtype == np.float32


def test_errors_name_what_is_wrong() -> None:
    with pytest.raises(ValueError, match="images: expected at least one, got none"):
        intensity_bounds([])
    with pytest.raises(ValueError, match=r"clip_percent: expected a number in .*, got 60"):
        intensity_bounds([np.zeros((4, 4))], 60)
    with pytest.raises(ValueError, match="got 16 NaN"):
        stretch(np.full((4, 4), np.nan), (0.0, 1.0))
