from __future__ import annotations

import cv2
import numpy as np
import pytest
from helpers.pictures import colored_leaves, leaves, need_data, psnr, real_images, to_bytes, wave
from hypothesis import given, settings
from hypothesis import strategies as st

from uw_recon_ros.preprocess.color import luminance
from uw_recon_ros.preprocess.moire import find_moire, remove_moire, remove_waves

FREQUENCIES = [(0.137, 0.2213), (0.0, 0.31), (-0.21, 0.11), (0.3, 0.5), (0.5, 0.5), (0.49, 0.003)]


@pytest.mark.parametrize("seed", range(4))
def test_clean_picture_comes_back_itself(seed: int) -> None:
    image = colored_leaves(200, 270, seed)
    assert remove_moire(image) is image


@pytest.mark.parametrize("quality", [3, 10, 50])
def test_blocks_of_a_jpeg_are_no_moire(quality: int) -> None:
    code = cv2.imencode(".jpg", to_bytes(leaves(240, 320)), [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    assert len(find_moire(cv2.imdecode(code, cv2.IMREAD_GRAYSCALE).astype(np.float32) / 255)) == 0


def test_photographs_come_back_themselves() -> None:
    need_data()
    for path in real_images():
        image = cv2.imread(str(path)).astype(np.float32) / 255
        assert remove_moire(image) is image, path
        jpeg = cv2.imdecode(cv2.imencode(".jpg", cv2.imread(str(path)), [cv2.IMWRITE_JPEG_QUALITY, 20])[1], 1)
        assert len(find_moire(luminance(jpeg.astype(np.float32) / 255))) == 0, f"{path} as a JPEG of quality 20"


@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_wave_is_found_once_and_where_it_is(frequency: tuple[float, float]) -> None:
    image = leaves(240, 320) + wave(240, 320, frequency, 8 / 255)
    found = find_moire(image)
    assert found.shape == (1, 2)
    off = found[0] - frequency
    mirrored = found[0] + frequency
    error = min(np.abs(e - np.round(e)).max() for e in (off, mirrored))
    assert error < 0.1 / 240  # a tenth of a bin


@pytest.mark.parametrize("frequency", FREQUENCIES)
def test_wave_is_removed(frequency: tuple[float, float]) -> None:
    clean = colored_leaves(240, 320)
    dirty = clean + wave(240, 320, frequency, 10 / 255)[..., None] * np.array([1.0, 0.8, 1.2], np.float32)
    assert psnr(dirty, clean) < 32
    assert psnr(remove_moire(dirty), clean) > 48


def test_several_waves_that_fade_are_removed() -> None:
    clean = leaves(300, 400)
    fading = np.linspace(0.6, 1.4, 400, dtype=np.float32)
    dirty = clean + fading * (wave(300, 400, (0.11, 0.23), 8 / 255) + wave(300, 400, (0.31, -0.17), 6 / 255))
    assert psnr(dirty, clean) < 33
    assert psnr(remove_moire(dirty), clean) > 45


def test_wave_on_a_photograph_is_removed() -> None:
    need_data()
    for path in real_images():
        clean = luminance(cv2.imread(str(path)).astype(np.float32) / 255)
        dirty = clean + wave(*clean.shape, (-0.21, 0.11), 10 / 255)
        assert psnr(remove_moire(dirty), clean) > psnr(dirty, clean) + 15, path


def chequers(shape: tuple[int, int], period: float, *, perspective: bool = False) -> np.ndarray:
    v, u = np.mgrid[: shape[0], : shape[1]].astype(float)
    if perspective:
        v, u = v / (1 - v / (1.6 * shape[0])), (u - shape[1] / 2) / (1 - v / (1.6 * shape[0]))
    return ((np.sin(2 * np.pi * u / period) > 0) ^ (np.sin(2 * np.pi * v / period) > 0)).astype(np.float32)


def net(shape: tuple[int, int]) -> np.ndarray:
    """A fishing net: thin threads, bent by a slow random current."""
    rng = np.random.default_rng(3)
    bend = [4 * cv2.GaussianBlur(rng.normal(0, 1, shape), (0, 0), 25) * 25 for _ in range(2)]
    v, u = np.mgrid[: shape[0], : shape[1]]
    threads = [np.cos(2 * np.pi * (x + y) / 11.0) > 0.7 for x, y in ((v, bend[0]), (u, bend[1]))]
    return 0.4 + 0.4 * (threads[0] | threads[1]).astype(np.float32)


REGULAR = {
    "chequerboard": chequers((240, 320), 12.5),
    "chequerboard in perspective": chequers((240, 320), 14.0, perspective=True),
    "pixel blocks": np.kron(np.random.default_rng(0).random((30, 40)), np.ones((8, 8))).astype(np.float32),
    "stripes": (np.mgrid[:240, :320][1] % 9 < 4).astype(np.float32),
    "fishing net": net((240, 320)),
    "noise": np.random.default_rng(1).random((240, 320)).astype(np.float32),
    "one edge": np.tri(240, 320, 30, np.float32),
    "flat": np.full((240, 320), 0.3, np.float32),
}


@pytest.mark.parametrize("name", REGULAR)
def test_regular_textures_are_no_moire(name: str) -> None:
    texture = REGULAR[name]
    grainy = texture + np.random.default_rng(2).normal(0, 0.01, texture.shape).astype(np.float32)
    assert len(find_moire(texture)) == 0
    assert len(find_moire(grainy)) == 0


def test_grating_on_a_part_of_the_picture_is_no_moire() -> None:
    image = leaves(240, 320)
    image[60:150, 100:220] = 0.5 + wave(90, 120, (0.1, 0.17), 0.3)
    assert len(find_moire(image)) == 0


def test_wave_over_a_striped_object_is_found() -> None:
    image = leaves(240, 320)
    image[60:120, 60:140] = 0.3 + 0.4 * REGULAR["stripes"][60:120, 60:140]
    assert len(find_moire(image)) == 0
    found = find_moire(image + wave(240, 320, (0.23, 0.17), 0.1))
    assert found == pytest.approx(np.array([[0.23, 0.17]]), abs=1e-3)


@pytest.mark.parametrize("quality", [95, 80, 50])
def test_wave_under_jpeg_is_found(quality: int) -> None:
    blocky = to_bytes(leaves(240, 320) + wave(240, 320, (0.23, 0.17), 0.05))
    code = cv2.imencode(".jpg", blocky, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    blocky = cv2.imdecode(code, cv2.IMREAD_GRAYSCALE).astype(np.float32) / 255
    assert find_moire(blocky) == pytest.approx(np.array([[0.23, 0.17]]), abs=1e-3)


def test_slow_waves_are_the_pictures_own() -> None:
    image = 0.5 + 0.1 * np.random.default_rng(0).random((240, 320)) + wave(240, 320, (0.04, 0.02), 0.2)
    assert len(find_moire(image)) == 0
    assert len(find_moire(image, min_frequency=0.01)) == 1


def test_only_the_strongest_are_returned() -> None:
    image = leaves(240, 320) + wave(240, 320, (0.2, 0.2), 0.02) + wave(240, 320, (0.3, 0.1), 0.05)
    assert find_moire(image, max_waves=1) == pytest.approx(np.array([[0.3, 0.1]]), abs=1e-3)


@settings(max_examples=15)
@given(
    st.integers(32, 90), st.integers(32, 90), st.floats(-0.4, 0.4), st.floats(0.1, 0.4),
    st.sampled_from([np.float32, np.float64]),
)  # fmt: skip
def test_pure_wave_vanishes_at_any_frequency_and_size(
    height: int, width: int, along_v: float, along_u: float, dtype: type
) -> None:
    pure = wave(height, width, (along_v, along_u), 0.3).astype(dtype)
    rest = remove_waves(pure, np.array([[along_v, along_u]]))
    assert rest.dtype == dtype
    assert np.abs(rest).mean() < 0.03 * np.abs(pure).mean()


def test_tiny_pictures_are_left_alone() -> None:
    assert find_moire(np.random.default_rng(0).random((31, 300))).shape == (0, 2)


def test_errors_name_what_is_wrong() -> None:
    with pytest.raises(TypeError, match=r"gray: expected float32 or float64, got uint8"):
        find_moire(np.zeros((40, 40), np.uint8))
    with pytest.raises(ValueError, match=r"gray: expected finite values, got 1 NaN"):
        find_moire(np.where(np.eye(40) * np.arange(40) == 3, np.nan, 0.5))
    with pytest.raises(ValueError, match=r"frequencies: expected shape \(N, 2\), got \(2,\)"):
        remove_waves(np.zeros((40, 40)), np.array([0.1, 0.2]))
