"""The automatic range covers the truth, is not much wider, and says when it cannot be found."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from helpers.match_scenes import STEREO
from numpy.typing import NDArray

from uw_recon_ros.errors import EstimationError
from uw_recon_ros.files.disparities import read_disparity
from uw_recon_ros.files.images import read_image
from uw_recon_ros.images import to_gray
from uw_recon_ros.match.disparity_range import find_disparity_range

Image = NDArray[np.uint8]


def slanted(width: int, low: float, high: float, noise: float = 0.0, gain: float = 1.0) -> tuple[Image, Image]:
    """A textured floor whose disparity grows from the top row to the bottom one."""
    random = np.random.RandomState(4)
    height = width * 3 // 4
    left = cv2.normalize(
        cv2.GaussianBlur(random.uniform(0, 255, (height, width)), (0, 0), 2), None, 40, 200, cv2.NORM_MINMAX
    )
    u, v = np.meshgrid(np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float32))
    disparity = low + (high - low) * v / height
    right = cv2.remap(left, u + disparity.astype(np.float32), v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    return tuple(  # type: ignore[return-value]
        np.clip(gain_of * image + random.normal(0, noise, image.shape), 0, 255).astype(np.uint8)
        for image, gain_of in ((left, 1.0), (right, gain))
    )


@pytest.mark.parametrize(
    ("width", "low", "high"), [(120, 2, 9), (320, 10, 50), (640, -40, 20), (640, 100, 190), (1000, -90, -30)]
)
def test_range_covers_the_truth_and_little_more(width: int, low: int, high: int) -> None:
    found = find_disparity_range(*slanted(width, low, high))
    slack = 8 * max(1, width / 256)
    assert low - slack <= found[0] <= low
    assert high <= found[1] <= high + slack


def test_brightness_and_noise_do_not_matter() -> None:
    low, high = find_disparity_range(*slanted(320, 10, 50, noise=6.0, gain=0.7))
    assert 0 <= low <= 10
    assert 50 <= high <= 62


def test_no_texture_and_no_likeness_are_reported() -> None:
    flat = np.full((90, 120), 80, np.uint8)
    with pytest.raises(EstimationError, match=r"got 0 of 0 textured ones \(120 x 90 px pair\)"):
        find_disparity_range(flat, flat)
    random = np.random.RandomState(1)
    left, right = (random.randint(0, 256, (90, 120)).astype(np.uint8) for _ in range(2))
    with pytest.raises(EstimationError, match="expected at least 40 pixels that match beyond doubt"):
        find_disparity_range(left, right)


@pytest.mark.parametrize("shape", [(1, 1), (1, 50), (50, 1), (3, 2)])
def test_tiny_images_are_refused_politely(shape: tuple[int, int]) -> None:
    with pytest.raises(EstimationError):
        find_disparity_range(np.zeros(shape, np.uint8), np.zeros(shape, np.uint8))


@pytest.mark.parametrize("name", ["tsukuba", "venus", "teddy", "cones"])
def test_real_pairs(name: str) -> None:
    if not STEREO.is_dir():
        pytest.skip(f"{STEREO} is not here")
    left, right = (to_gray(read_image(STEREO / name / f"{side}.png")) for side in ("left", "right"))
    low, high = find_disparity_range(left, right)
    truth = read_disparity(STEREO / name / "gt.pfm")
    least, greatest = np.nanmin(truth[truth > 0]), np.nanmax(truth)
    assert least - 10 <= low <= least
    assert greatest <= high <= greatest + 10
