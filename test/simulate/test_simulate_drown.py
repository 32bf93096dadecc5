"""Ordinary pictures drowned: the formulas, and one world for both cameras."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from uw_recon_ros.files.images import read_image
from uw_recon_ros.simulate.drown import drown, drown_pair, ranges_from_disparity, right_disparity
from uw_recon_ros.simulate.image_sensor import to_light
from uw_recon_ros.simulate.water import make_water

MIDDLEBURY = Path(__file__).parents[3] / "shared" / "data" / "stereo"


def steps() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Left and right image and left disparity of a square (12 px) before a wall (5 px), textured."""
    rng = np.random.default_rng(3)
    wall, square = (cv2.GaussianBlur(rng.integers(0, 256, (60, 140, 3), dtype=np.uint8), (0, 0), 1.0) for _ in range(2))
    left, right = wall[:, 20:120].copy(), wall[:, 25:125].copy()
    disparity = np.full((60, 100), 5.0, np.float32)
    left[20:40, 40:60] = square[20:40, 40:60]
    right[20:40, 28:48] = square[20:40, 40:60]
    disparity[20:40, 40:60] = 12.0
    return left, right, disparity


def test_drowned_light_is_the_formula() -> None:
    image = np.full((10, 12, 3), 180, np.uint16) * 257
    water = make_water("5C", blur_px_m=0.0)
    for z in (0.5, 2.0):
        wet = drown(image, np.full((10, 12), z), water, np.random.default_rng(1), noise=0.0, exposure=1.0, daylight=0.7)
        expected = to_light(image)[0, 0] * np.exp(-water.attenuation * z)
        expected += 0.7 * water.veil * (1 - np.exp(-water.backscatter * z))
        assert to_light(wet)[5, 5] == pytest.approx(expected, abs=2e-4)


@pytest.mark.parametrize("shape", [(20, 30), (20, 30, 3)])
@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
def test_form_is_kept(shape: tuple[int, ...], dtype: type) -> None:
    image = np.random.default_rng(1).integers(0, np.iinfo(dtype).max, shape).astype(dtype)
    wet = drown(image, np.full((20, 30), 2.0), make_water("3C"), np.random.default_rng(2))
    assert (wet.shape, wet.dtype) == (shape, dtype)


def test_unknown_ranges_take_the_median() -> None:
    image = np.full((10, 12, 3), 120, np.uint8)
    ranges = np.full((10, 12), 1.5)
    holed = ranges.copy()
    holed[2:5, 3:6] = np.nan
    water = make_water("3C")
    a, b = (drown(image, r, water, np.random.default_rng(2)) for r in (ranges, holed))
    assert np.array_equal(a, b)


def test_clear_water_and_no_noise_give_the_picture_back() -> None:
    image = np.random.default_rng(1).integers(0, 256, (20, 30, 3), dtype=np.uint8)
    same = drown(image, np.full((20, 30), 3.0), make_water("clear"), np.random.default_rng(2), noise=0.0, exposure=1.0)
    assert np.abs(same.astype(int) - image).max() <= 1


def test_ranges_from_disparity() -> None:
    ranges = ranges_from_disparity(np.array([[40.0, 20.0, 0.0, np.inf, np.nan, 10.0]], np.float32), 1.5)
    assert ranges[0] == pytest.approx([1.5, 3.0, np.nan, np.nan, np.nan, 6.0], nan_ok=True)
    with pytest.raises(ValueError, match="disparity: expected some positive values, got none"):
        ranges_from_disparity(np.zeros((2, 2), np.float32), 1.0)


def test_right_disparity_is_the_left_one_moved() -> None:
    _, _, disparity = steps()
    moved = right_disparity(disparity)
    expected = np.full((60, 100), 5.0, np.float32)
    expected[20:40, 28:48] = 12.0
    assert np.array_equal(moved, expected)


def test_pairs_still_match_under_water() -> None:
    left, right, disparity = steps()
    wet = drown_pair(left, right, disparity, make_water("5C"), 4, noise=0.0, nearest_m=1.2)
    u = (np.arange(100) - disparity).astype(np.float32)
    v = np.repeat(np.arange(60, dtype=np.float32)[:, None], 100, axis=1)
    warped = cv2.remap(wet[1], u, v, cv2.INTER_NEAREST).astype(int)
    inner = (slice(5, -5), slice(15, -15))
    assert np.percentile(np.abs(warped - wet[0])[inner], 80) <= 2
    contrast = [to_light(image).std(axis=(0, 1)) / to_light(image).mean(axis=(0, 1)) for image in (left, wet[0])]
    assert (contrast[1] < 0.9 * contrast[0]).all()


def test_snow_shows_in_both_cameras_at_its_own_disparity() -> None:
    flat = np.full((120, 160, 3), 60, np.uint8)
    disparity = np.full((120, 160), 8.0, np.float32)
    water = make_water("clear")
    dry = drown_pair(flat, flat, disparity, water, 4, noise=0.0, nearest_m=1.0)
    wet = drown_pair(flat, flat, disparity, water, 4, noise=0.0, nearest_m=1.0, snow=600)  # a few before the wall
    spots = [(w.max(axis=-1).astype(int) - d.max(axis=-1)) > 4 for w, d in zip(wet, dry, strict=True)]
    centres = [cv2.connectedComponentsWithStats(s.astype(np.uint8))[3][1:] for s in spots]
    assert len(centres[0]) >= 3
    matched = 0
    for x, y in centres[0]:
        apart = x - centres[1][np.abs(centres[1][:, 1] - y) < 0.6][:, 0]
        matched += bool(((apart > 8.0 - 0.6) & (apart < 4 * 8.0 + 0.6)).any())  # from the wall's to the nearest's
    assert matched >= 0.7 * len(centres[0])


def test_gain_difference() -> None:
    left, right, disparity = steps()
    arguments = left, right, disparity, make_water("3C"), 4
    plain, bright = drown_pair(*arguments, noise=0.0), drown_pair(*arguments, noise=0.0, gain_difference=0.3)
    assert np.array_equal(plain[0], bright[0])
    middle = (plain[1] > 60) & (plain[1] < 180)
    assert (bright[1][middle] / plain[1][middle]) ** 2.2 == pytest.approx(1.3, abs=0.06)


def test_same_seed_same_bytes() -> None:
    left, right, disparity = steps()
    a, b, c = (drown_pair(left, right, disparity, make_water("3C"), seed, snow=10) for seed in (1, 1, 2))
    assert np.array_equal(a[0], b[0])
    assert np.array_equal(a[1], b[1])
    assert not np.array_equal(a[0], c[0])


def test_middlebury() -> None:
    folder = MIDDLEBURY / "teddy"
    if not folder.is_dir():
        pytest.skip(f"{folder} is not there")
    left, right = read_image(folder / "left.png"), read_image(folder / "right.png")
    disparity = cv2.imread(str(folder / "gt.pfm"), cv2.IMREAD_UNCHANGED)
    wet = drown_pair(left, right, disparity, make_water("7C"), 1, nearest_m=1.0, snow=200)
    assert wet[0].shape == left.shape
    sharpness = [np.abs(np.diff(image[..., 1].astype(float), axis=1)).mean() for image in (left, wet[0])]
    assert 0.05 * sharpness[0] < sharpness[1] < sharpness[0]
