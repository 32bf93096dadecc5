"""Views of different sharpness: told from each other, and made alike."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from test_planes_matcher import texture

from uw_recon_ros.match.planes.gray import gray_pair, local_contrast
from uw_recon_ros.match.planes.sharpness import equally_sharp, sharpness

Gray = NDArray[np.int16]
SHIFT = 6


def views(left_blur: float, right_blur: float, gain: float = 1.0, noise: float = 0.0) -> tuple[Gray, Gray]:
    """Gray views of one texture, shifted; each blurred, the right one darker."""
    scene, random = texture(120, 200, 4, grain=0.9), np.random.RandomState(5)
    sides = []
    for at, blur, factor in ((0, left_blur, 1.0), (SHIFT, right_blur, gain)):
        seen = scene if not blur else cv2.GaussianBlur(scene, (0, 0), blur)
        seen = factor * seen[:, at : at + 180] + random.normal(0, noise, (120, 180, 1))
        sides.append(np.clip(np.round(seen), 0, 255).astype(np.uint8))
    left, right, *_ = gray_pair(*sides)
    return left, right


def apart(left: Gray, right: Gray) -> float:
    """Mean difference of what both views show of the same."""
    return float(np.abs(left[8:-8, 8 + SHIFT : -8].astype(float) - right[8:-8, 8 : -8 - SHIFT]).mean())


@pytest.mark.parametrize("gain", [1.0, 0.6])
@pytest.mark.parametrize("blurs", [(0.0, 1.0), (0.0, 1.5), (1.2, 0.0), (0.5, 1.3)])
def test_the_sharper_view_is_made_like_the_other(blurs: tuple[float, float], gain: float) -> None:
    left, right = views(*blurs, gain)
    like = equally_sharp(left, right)
    blurred = 0 if blurs[0] < blurs[1] else 1
    assert like[1 - blurred] is (left, right)[1 - blurred]
    assert sharpness(like[0][::4].astype(np.float32)) == pytest.approx(
        sharpness(like[1][::4].astype(np.float32)), rel=0.08
    )
    assert apart(*like) < 0.5 * apart(left, right)
    assert local_contrast(like[blurred]) == pytest.approx(local_contrast((left, right)[blurred]), rel=0.05)


@pytest.mark.parametrize("noise", [0.0, 3.0])
@pytest.mark.parametrize("gain", [1.0, 0.6])
@pytest.mark.parametrize("blur", [0.0, 1.0])
def test_views_as_sharp_as_each_other_stay(blur: float, gain: float, noise: float) -> None:
    left, right = views(blur, blur, gain, noise)
    like = equally_sharp(left, right)
    assert like[0] is left
    assert like[1] is right


@pytest.mark.parametrize("shape", [(1, 1), (1, 9), (9, 1), (3, 2)])
def test_tiny_and_empty_views_stay(shape: tuple[int, int]) -> None:
    left, right = np.zeros(shape, np.int16), np.zeros(shape, np.int16)
    assert equally_sharp(left, right)[0] is left
