"""Images and stamps against bytes written down by hand."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import CompressedImage, Image

from uw_recon_ros.errors import ImageError
from uw_recon_ros.images import decode_image
from uw_recon_ros.ros import messages

HEAD = messages.header(1_500_000_000_000_000_007, "cam_left_optical_frame")
RGB = np.array([[[1, 2, 3], [4, 5, 6]]], np.uint8)


def image(data: bytes, width: int, height: int, encoding: str, step: int, *, big: bool = False) -> Image:
    message = Image(width=width, height=height, encoding=encoding, step=step, is_bigendian=int(big))
    message.data.frombytes(data)
    return message


def test_stamp_splits_into_seconds_and_rest() -> None:
    assert (HEAD.stamp.sec, HEAD.stamp.nanosec) == (1_500_000_000, 7)
    assert messages.stamp_ns(Image(header=HEAD)) == 1_500_000_000_000_000_007


def test_stamp_before_1970_and_beyond_32_bits() -> None:
    early = messages.time_message(-1)
    assert (early.sec, early.nanosec) == (-1, 999_999_999)
    with pytest.raises(ValueError, match="32 bits"):
        messages.time_message(2**31 * 10**9)


def test_color_message_is_bgr() -> None:
    message = messages.image_message(RGB, HEAD)
    assert message.data.tobytes() == bytes([3, 2, 1, 6, 5, 4])
    assert (message.encoding, message.width, message.height, message.step) == ("bgr8", 2, 1, 6)
    assert message.header.frame_id == "cam_left_optical_frame"


def test_mono_message_of_a_view_that_is_not_contiguous() -> None:
    wide = np.arange(12, dtype=np.uint8).reshape(2, 6)
    message = messages.image_message(wide[:, ::3], HEAD)
    assert message.data.tobytes() == bytes([0, 3, 6, 9])
    assert message.step == 2


def test_float_message_is_ieee754_in_the_declared_order() -> None:
    message = messages.image_message(np.array([[1.0, np.nan]], np.float32), HEAD)
    one = bytes([0, 0, 0x80, 0x3F]) if sys.byteorder == "little" else bytes([0x3F, 0x80, 0, 0])
    assert message.data.tobytes()[:4] == one
    assert bool(message.is_bigendian) == (sys.byteorder == "big")
    assert (message.encoding, message.step) == ("32FC1", 8)


def test_image_from_message_skips_the_padding_of_each_row() -> None:
    padded = image(bytes([3, 2, 1, 6, 5, 4, 99, 99]), 2, 1, "bgr8", 8)
    np.testing.assert_array_equal(messages.image_from_message(padded), RGB)


def test_image_from_message_swaps_16_bit_bytes() -> None:
    big = image(bytes([0x01, 0x02]), 1, 1, "mono16", 2, big=True)
    little = image(bytes([0x01, 0x02]), 1, 1, "mono16", 2)
    assert messages.image_from_message(big)[0, 0] == 0x0102
    assert messages.image_from_message(little)[0, 0] == 0x0201


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (image(b"", 0, 0, "mono8", 0), "size"),
        (image(b"", 2, 2, "mono8", 2), "4 bytes, got 0"),
        (image(b"123", 2, 2, "mono8", 2), "4 bytes, got 3"),
        (image(b"1234", 2, 2, "mono8", 1), "step"),
        (image(b"1234", 2, 2, "telepathy8", 2), "telepathy8"),
        (image(b"", 2**31, 2**31, "mono8", 2**31), "size"),
    ],
)
def test_what_is_wrong_with_an_image_is_said(message: Image, words: str) -> None:
    with pytest.raises(ImageError, match=words):
        messages.image_from_message(message)


def test_compressed_image() -> None:
    import cv2

    message = CompressedImage(format="png")
    message.data.frombytes(cv2.imencode(".png", RGB[..., ::-1])[1].tobytes())
    np.testing.assert_array_equal(messages.image_from_message(message), RGB)


def test_truncated_compressed_image_is_refused() -> None:
    message = CompressedImage(format="jpeg")
    message.data.frombytes(b"\xff\xd8\xff")
    with pytest.raises(ImageError, match="compressed"):
        messages.image_from_message(message)


@given(
    width=st.integers(1, 5),
    height=st.integers(1, 5),
    padding=st.integers(0, 7),
    big=st.booleans(),
    seed=st.integers(0, 99),
)
@settings(max_examples=40)
def test_float_image_honours_step_and_order(width: int, height: int, padding: int, big: bool, seed: int) -> None:
    values = np.random.default_rng(seed).normal(size=(height, width)).astype(np.float32)
    rows = values.astype(">f4" if big else "<f4").view(np.uint8).reshape(height, 4 * width)
    data = np.hstack([rows, np.full((height, padding), 0xAB, np.uint8)]).tobytes()
    message = image(data, width, height, "32FC1", 4 * width + padding, big=big)
    read = messages.float_image_from_message(message)
    np.testing.assert_array_equal(read, values)
    assert read.dtype == np.float32
    assert read.dtype.isnative


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (image(b"1234", 1, 1, "16UC1", 4), "expected 32FC1, got '16UC1'"),
        (image(b"1234", 2, 1, "32FC1", 4), "step"),
        (image(b"123", 1, 1, "32FC1", 4), "4 bytes, got 3"),
        (image(b"", 0, 5, "32FC1", 0), "size"),
    ],
)
def test_what_is_wrong_with_a_float_image_is_said(message: Image, words: str) -> None:
    with pytest.raises(ImageError, match=words):
        messages.float_image_from_message(message)


@given(seed=st.integers(0, 1000), width=st.integers(1, 9), height=st.integers(1, 9))
@settings(max_examples=20)
def test_color_survives_the_wire(seed: int, width: int, height: int) -> None:
    pixels = np.random.default_rng(seed).integers(0, 256, (height, width, 3), np.uint8)
    received = deserialize_message(serialize_message(messages.image_message(pixels, HEAD)), Image)
    np.testing.assert_array_equal(messages.image_from_message(received), pixels)


def test_a_message_is_filled_once_and_not_appended_to() -> None:
    first = messages.image_message(np.zeros((2, 2), np.uint8), HEAD)
    second = messages.image_message(np.ones((2, 2), np.uint8), HEAD)
    assert len(first.data) == len(second.data) == 4


def test_reading_does_not_copy_mono_images() -> None:
    message = messages.image_message(np.zeros((4, 4), np.uint8), HEAD)
    read = messages.image_from_message(message)
    message.data[0] = 7
    assert read[0, 0] == 7
    assert decode_image(message.data, height=4, width=4, encoding="mono8", step=4)[0, 0] == 7
