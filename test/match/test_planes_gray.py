"""Compression is told from images as they were taken."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from test_planes_matcher import texture

from uw_recon_ros.match.planes.gray import compression, gray_pair, mix

Image = NDArray[np.uint8]


def taken(grain: float, noise: float = 0.0) -> Image:
    image = texture(216, 240, 6, grain) + np.random.RandomState(7).normal(0, noise, (216, 240, 3))
    return np.asarray(np.clip(np.round(image), 0, 255), np.uint8)


def compressed(image: Image, quality: int) -> Image:
    _, packed = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, quality])
    return np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), np.uint8)


@pytest.mark.parametrize("crop", [0, 3])
@pytest.mark.parametrize("grain", [2.5, 5.0])
def test_blocks_are_seen_wherever_they_begin(grain: float, crop: int) -> None:
    image = compressed(taken(grain), 15)[crop:, crop:]
    assert compression(mix(image, 0)) > 0.5
    assert gray_pair(image, image)[2] > 0.5


@pytest.mark.parametrize("noise", [0.0, 3.0])
@pytest.mark.parametrize("grain", [0.8, 1.2, 2.5, 5.0])
def test_what_was_taken_as_it_is_has_none(grain: float, noise: float) -> None:
    assert compression(mix(taken(grain, noise), 0)) == 0


def test_a_few_stripes_of_a_small_image_are_no_grid() -> None:
    """Such as wood at a quarter of its size, where brightness is compared."""
    for seed in range(40):
        rng = np.random.RandomState(seed)
        stripes = rng.randint(60, 120, 16).repeat(7)[:106] + rng.randint(0, 40, 12).repeat(8)[:92, None]
        assert compression((stripes + rng.normal(0, 1, (92, 106))).astype(np.float32)) == 0


@pytest.mark.parametrize("shape", [(1, 1), (63, 300), (64, 64)])
def test_small_and_even_images_have_none(shape: tuple[int, int]) -> None:
    assert compression(np.full(shape, 90, np.float32)) == 0
