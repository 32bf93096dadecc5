"""The size an encoded image declares: that of the real encoders, and the limits."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uw_recon_ros.bounds import LARGEST_PIXELS
from uw_recon_ros.errors import ImageError
from uw_recon_ros.files.image_header import declared_size
from uw_recon_ros.files.images import decode_compressed

FORMATS = (".png", ".jpg", ".tiff", ".bmp", ".webp", ".jp2", ".ppm")


def encoded(extension: str, height: int, width: int, *options: int) -> bytes:
    image = np.random.default_rng(width).integers(0, 256, (height, width, 3), np.uint8)
    return bytes(cv2.imencode(extension, image, list(options))[1])


@pytest.mark.parametrize("extension", FORMATS)
@pytest.mark.parametrize(("height", "width"), [(33, 47), (300, 257)])
def test_it_is_the_size_that_is_decoded(extension: str, height: int, width: int) -> None:
    data = encoded(extension, height, width)
    assert declared_size(memoryview(data)) == (width, height)
    assert decode_compressed(data).shape == (height, width, 3)


def test_other_forms_of_a_format() -> None:
    assert declared_size(memoryview(encoded(".webp", 40, 60, cv2.IMWRITE_WEBP_QUALITY, 101))) == (60, 40)
    assert declared_size(memoryview(encoded(".jpg", 40, 60, cv2.IMWRITE_JPEG_PROGRESSIVE, 1))) == (60, 40)
    assert declared_size(memoryview(b"P5\n# a remark\n60 40\n255\n" + bytes(2400))) == (60, 40)


@pytest.mark.parametrize("extension", FORMATS)
@settings(max_examples=25)
@given(share=st.floats(0, 0.9), place=st.integers(0, 40), value=st.integers(0, 255))
def test_what_is_damaged_or_cut_is_read_or_refused_and_nothing_else(
    extension: str, share: float, place: int, value: int
) -> None:
    """A flipped byte may still be an image; nothing but `ImageError` says that it is none."""
    data = bytearray(encoded(extension, 40, 48))
    data[place] = value
    for spoiled in (bytes(data), bytes(data[: int(share * len(data))])):
        try:
            image = decode_compressed(spoiled)
        except ImageError:
            continue
        assert image.shape[0] * image.shape[1] <= LARGEST_PIXELS


def test_a_jpeg_cut_short_is_refused_not_filled_with_gray() -> None:
    data = encoded(".jpg", 64, 64)
    with pytest.raises(ImageError, match="cut short: no end-of-image marker"):
        decode_compressed(data[: len(data) // 2])
    assert decode_compressed(data + bytes(64)).shape == (64, 64, 3), "cameras pad"


def test_the_limit_counts_pixels() -> None:
    head = b"P5 %d %d 255\n"
    assert declared_size(memoryview(head % (8192, 8192))) == (8192, 8192)
    with pytest.raises(ImageError, match="expected a size of 1 to 67108864 px, got 8193x8192"):
        declared_size(memoryview(head % (8193, 8192)))
