from __future__ import annotations

import cv2
import numpy as np
import pytest
from helpers.pictures import Image, leaves, to_bytes
from hypothesis import given, settings
from hypothesis import strategies as st

from uw_recon_ros.preprocess.guided import guided_smooth
from uw_recon_ros.preprocess.stage import Preprocess
from uw_recon_ros.preprocess.white_balance import MOST_GAIN, white_balance
from uw_recon_ros.types import StereoPair


def shown(left: Image, right: Image | None = None) -> Image:
    """The left image as it is shown."""
    return Preprocess()(StereoPair(left, left if right is None else right)).left


def drowned(gains: tuple[float, float, float], veil: tuple[float, float, float] = (0, 0, 0)) -> Image:
    """Gray discs through a water of one range: affine in linear light."""
    light = np.square(leaves(240, 320))[..., None] * np.array(gains) + np.array(veil)
    return to_bytes(np.sqrt(np.clip(light, 0, 1)))


def chroma(image: Image) -> float:
    """Mean distance of R, G and B from each other, of 255."""
    return float(np.ptp(image.astype(float), axis=2).mean())


@pytest.mark.parametrize("gains", [(0.1, 0.8, 0.7), (0.5, 0.6, 0.2), (0.9, 0.3, 0.3)])
def test_gray_things_come_out_gray(gains: tuple[float, float, float]) -> None:
    image = drowned(gains)
    assert chroma(image) > 30
    assert chroma(shown(image)) < 8


def test_a_dead_channel_is_lent_by_the_others_and_darkens_nothing() -> None:
    """The red channel is 0, as far down: what was black and blue is gray, as bright as a picture should be."""
    out = shown(drowned((0.0, 0.06, 0.065), (0.0, 0.004, 0.004)))
    assert chroma(out) < 8
    assert 80 < np.median(out) < 180
    assert np.percentile(out, 95) - np.percentile(out, 5) > 60


def test_no_rim_at_an_edge() -> None:
    """Beside a step both sides stay monotone: no hollow squares, no bright line round a diver."""
    gray = np.full((240, 320), 70, np.uint8)
    gray[60:180, 100:220] = 170
    out = shown(np.repeat(cv2.GaussianBlur(gray, (0, 0), 1.0)[..., None], 3, axis=2))[120].mean(axis=-1)
    inside, outside = out[104:216], np.concatenate([out[:96], out[224:]])
    assert np.ptp(inside) < 6
    assert np.ptp(outside) < 6
    assert inside.mean() - outside.mean() > 60


def test_noise_is_not_raised_more_than_contrast() -> None:
    clean = leaves(240, 320, count=60)
    noisy = to_bytes(clean[..., None] + np.random.default_rng(1).normal(0, 6 / 255, (240, 320, 3)))
    out = shown(noisy).astype(float)
    flat = np.abs(cv2.Laplacian(clean, cv2.CV_32F, ksize=5)) < 0.5
    before, after = noisy.astype(float).mean(axis=2), out.mean(axis=2)
    raised = np.polyfit(clean.ravel(), after.ravel(), 1)[0] / np.polyfit(clean.ravel(), before.ravel(), 1)[0]
    high_pass = [np.std((x - cv2.blur(x, (5, 5)))[flat]) for x in (before, after)]
    assert high_pass[1] < 0.8 * raised * high_pass[0]


def test_bubbles_and_lamps_stay_white() -> None:
    """Where two channels are at their end the colour is not known: a balance that turns it yellow is not believed."""
    image = drowned((0.1, 0.5, 0.6))
    image[100:140, 100:140] = (120, 255, 255)
    out = shown(image)[110:130, 110:130].astype(float)
    assert np.ptp(out, axis=2).max() < 12


def test_both_cameras_by_one_balance() -> None:
    image = drowned((0.2, 0.7, 0.6))
    out = Preprocess()(StereoPair(image, image[:, ::-1].copy()))
    np.testing.assert_allclose(out.left.astype(int), out.right[:, ::-1].astype(int), atol=2)


def test_balance_of_a_known_water_is_its_inverse() -> None:
    light = np.square(leaves(240, 320)).astype(np.float32)
    gains = np.array([0.2, 0.8, 0.5], np.float32)
    found = white_balance([np.sqrt(light[..., None] * gains)])
    np.testing.assert_allclose(np.diag(found[:, :3]) * gains, 0.8, rtol=0.02)
    assert np.abs(found[:, :3][~np.eye(3, dtype=bool)]).max() == 0


def test_no_gain_over_the_limit() -> None:
    light = np.square(leaves(240, 320)).astype(np.float32)[..., None] * np.array([1e-3, 1, 1], np.float32)
    found = white_balance([np.sqrt(light)])
    assert found[0, 0] <= MOST_GAIN
    assert found[0, 1] > 0.4
    assert found[0, 2] > 0.4


@settings(max_examples=15)
@given(st.integers(1, 40), st.integers(1, 40), st.booleans())
def test_any_size(height: int, width: int, color: bool) -> None:
    rng = np.random.default_rng(height * 41 + width)
    image = rng.integers(0, 256, (height, width, 3) if color else (height, width)).astype(np.uint8)
    assert shown(image).shape == (height, width, 3)


def test_guided_smoothing_keeps_steps_and_takes_noise() -> None:
    step = np.where(np.arange(200) < 100, 0.2, 0.8)[None].repeat(100, axis=0).astype(np.float32)
    noisy = step + np.random.default_rng(0).normal(0, 0.02, step.shape).astype(np.float32)
    for reduction in (1, 2):
        smooth = guided_smooth(noisy, radius=4, edge=0.1, reduction=reduction)
        assert np.std(smooth[:, 10:80]) < 0.008
        assert np.abs(smooth[:, :98].mean(axis=0) - 0.2).max() < 0.06
    np.testing.assert_allclose(guided_smooth(noisy, radius=4, edge=0.0), noisy, atol=1e-5)
    with pytest.raises(ValueError, match="radius"):
        guided_smooth(noisy, radius=0, edge=0.1)
