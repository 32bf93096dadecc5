from __future__ import annotations

import threading

import numpy as np
import pytest

from uw_recon_ros.errors import ImageError
from uw_recon_ros.preprocess.image_pairs import TwoThreads, checked_images, full_scale, unit_from_raw
from uw_recon_ros.types import StereoPair

GRAY = np.zeros((4, 6), np.uint8)


def test_two_threads_keep_the_cameras_apart() -> None:
    with TwoThreads() as both:
        assert both(lambda a, b: a - b, (10, 20), (1, 2)) == (9, 18)
        left, right = both(lambda _: threading.get_ident(), (0, 0))
    assert left != right


@pytest.mark.parametrize("view", [0, 1])
def test_an_error_in_either_camera_arrives(view: int) -> None:
    def fail(index: int) -> None:
        if index == view:
            raise ImageError(f"camera {index}")

    with TwoThreads() as both, pytest.raises(ImageError, match=f"camera {view}"):
        both(fail, (0, 1))


@pytest.mark.parametrize(
    ("left", "right", "text"),
    [
        (GRAY, GRAY[:3], r"right: expected the left image's shape and dtype, \(4, 6\) uint8, got \(3, 6\) uint8"),
        (GRAY, GRAY.astype(np.uint16), r"\(4, 6\) uint8, got \(4, 6\) uint16"),
        (GRAY, np.zeros((4, 6, 3), np.uint8), r"got \(4, 6, 3\) uint8"),
        (GRAY[:0], GRAY[:0], r"left: expected shape .* with at least one pixel, got \(0, 6\)"),
        (GRAY, np.zeros((4, 6, 4), np.uint8), r"right: expected shape .*, got \(4, 6, 4\)"),
        (GRAY.ravel(), GRAY.ravel(), r"left: expected shape .*, got \(24,\)"),
    ],
)
def test_bad_images_are_refused(left: np.ndarray, right: np.ndarray, text: str) -> None:
    with pytest.raises(ImageError, match=text):
        checked_images(StereoPair(left, right))


@pytest.mark.parametrize("dtype", [np.float32, np.int16, bool])
def test_other_dtypes_are_the_callers_mistake(dtype: type) -> None:
    with pytest.raises(TypeError, match=f"left: expected uint8 or uint16, got {np.dtype(dtype)}"):
        checked_images(StereoPair(GRAY.astype(dtype), GRAY.astype(dtype)))


@pytest.mark.parametrize(
    ("left", "right", "scale"),
    [(200, 255, 255), (256, 3, 1023), (900, 4095, 4095), (4096, 0, 16383), (1, 65535, 65535)],
)
def test_scale_is_common_to_both_cameras_and_fits_the_brighter(left: int, right: int, scale: float) -> None:
    views = np.full((2, 2), left, np.uint16), np.full((2, 2), right, np.uint16)
    assert full_scale(views) == scale
    assert full_scale(views, 12) == 4095
    assert full_scale((GRAY, GRAY), 12) == 255


def test_unit() -> None:
    unit = unit_from_raw(np.array([[0, 51, 255]], np.uint8), 255.0)
    assert unit.dtype == np.float32
    np.testing.assert_allclose(unit, [[0, 0.2, 1]], atol=1e-7)
