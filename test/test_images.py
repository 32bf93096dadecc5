"""Image bytes in every encoding, on absolute bytes."""

from __future__ import annotations

import struct
from collections.abc import Callable
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from uw_recon_ros.errors import ImageError
from uw_recon_ros.files.images import decode_compressed, read_image, write_image
from uw_recon_ros.images import decode_image, to_gray
from uw_recon_ros.messages.images import image_from_message


def test_bgr_with_padded_rows_becomes_rgb() -> None:
    data = bytes([1, 2, 3, 4, 5, 6, 99, 99, 7, 8, 9, 10, 11, 12, 99, 99])
    image = decode_image(data, height=2, width=2, encoding="bgr8", step=8)
    assert image.tolist() == [[[3, 2, 1], [6, 5, 4]], [[9, 8, 7], [12, 11, 10]]]


@pytest.mark.parametrize(("big", "expected"), [(False, 0x0201), (True, 0x0102)])
def test_byte_order_of_16_bits(big: bool, expected: int) -> None:
    image = decode_image(b"\x01\x02\x09", height=1, width=1, encoding="mono16", step=3, is_bigendian=big)
    assert image.dtype == np.uint16
    assert image.tolist() == [[expected]]


@pytest.mark.parametrize(
    ("encoding", "pixel", "expected"),
    [
        ("rgb8", [1, 2, 3], [1, 2, 3]),
        ("rgba8", [1, 2, 3, 4], [1, 2, 3]),
        ("bgra8", [1, 2, 3, 4], [3, 2, 1]),
        ("8UC3", [1, 2, 3], [3, 2, 1]),
        ("mono8", [7], 7),
        ("8UC1", [7], 7),
    ],
)
def test_channel_order(encoding: str, pixel: list[int], expected: object) -> None:
    image = decode_image(bytes(pixel), height=1, width=1, encoding=encoding, step=len(pixel))
    assert image[0, 0].tolist() == expected


@pytest.mark.parametrize("pattern", ["rggb", "bggr", "gbrg", "grbg"])
@pytest.mark.parametrize("bits", [8, 16])
def test_bayer_mosaic_of_one_colour_is_that_colour(pattern: str, bits: int) -> None:
    value = {"r": 200, "g": 100, "b": 50}
    tile = np.array([[value[pattern[0]], value[pattern[1]]], [value[pattern[2]], value[pattern[3]]]])
    mosaic = np.tile(tile, (6, 6)).astype(f"<u{bits // 8}")
    image = decode_image(mosaic.tobytes(), height=12, width=12, encoding=f"bayer_{pattern}{bits}", step=12 * bits // 8)
    assert (image == [200, 100, 50]).all()


@pytest.mark.parametrize("encoding", ["nv12", "nv21", "i420", "NV12"])
@pytest.mark.parametrize("counted", [False, True])
def test_planar_yuv(encoding: str, counted: bool) -> None:
    """FFmpeg's conversion is the oracle; drivers count the rows of colour as height, or do not."""
    av = pytest.importorskip("av", reason="the oracle: pip install av")
    noise = np.random.default_rng(4).integers(60, 200, (3, 4, 3), np.uint8)
    image = cv2.resize(noise, (64, 48), interpolation=cv2.INTER_LINEAR)
    name = {"i420": "yuv420p", "nv21": "nv12"}.get(encoding, encoding.lower())
    frame = av.VideoFrame.from_ndarray(image, format="rgb24")
    data = frame.reformat(format=name, dst_colorspace="itu601").to_ndarray()
    if encoding == "nv21":
        data[48:] = data[48:].reshape(24, 32, 2)[..., ::-1].reshape(24, 64)
    assert data.shape == (72, 64)
    shown = decode_image(data.tobytes(), height=72 if counted else 48, width=64, encoding=encoding, step=64)
    assert shown.shape == (48, 64, 3)
    assert np.abs(shown.astype(int) - image).mean() < 6
    with pytest.raises(ImageError, match="image data"):
        decode_image(data.tobytes()[:-64], height=48, width=64, encoding=encoding, step=64)


@pytest.mark.parametrize("order", ["rggb", "bggr", "gbrg", "grbg"])
def test_a_mosaic_in_a_png(order: str) -> None:
    """Of one colour: every order tells its own channels."""
    colour = np.array([200, 120, 40], np.uint8)
    mosaic = np.empty((8, 8), np.uint8)
    for place, name in enumerate(order):
        mosaic[place // 2 :: 2, place % 2 :: 2] = colour["rgb".index(name)]
    data = cv2.imencode(".png", mosaic)[1].tobytes()
    told = f"bayer_{order}8; png compressed bayer_{order}8"
    assert image_from_message(SimpleNamespace(data=data, format=told))[4, 4].tolist() == colour.tolist()
    assert image_from_message(SimpleNamespace(data=data, format="mono8; png compressed ")).ndim == 2


def test_yuv422_of_grey_is_grey() -> None:
    image = decode_image(bytes([128, 180, 128, 180]), height=1, width=2, encoding="yuv422", step=4)
    assert np.ptp(image) == 0
    assert abs(int(image[0, 0, 0]) - round((180 - 16) * 255 / 219)) <= 1


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"step": 5}, "step: expected at least 6 bytes"),
        ({"data": bytes(11)}, "expected step x height = 6 x 2 = 12 bytes, got 11"),
        ({"data": b""}, "got 0"),
        ({"encoding": "32FC1"}, "encoding: expected"),
        ({"encoding": "bayer_xxxx8"}, "encoding: expected"),
        ({"encoding": ""}, "encoding: expected"),
        ({"width": 0}, "image size: expected"),
        ({"height": 2**31, "width": 2**31}, "image size: expected"),
    ],
)
def test_malformed_images_are_refused_with_numbers(change: dict[str, object], words: str) -> None:
    fields: dict[str, object] = {"data": bytes(12), "height": 2, "width": 2, "encoding": "rgb8", "step": 6}
    with pytest.raises(ImageError, match=words):
        decode_image(**(fields | change))  # type: ignore[arg-type]


@settings(max_examples=60)
@given(
    data=st.binary(max_size=64),
    height=st.integers(-1, 9),
    width=st.integers(-1, 9),
    step=st.integers(-1, 40),
    encoding=st.sampled_from(["mono8", "mono16", "rgb8", "bgr16", "bayer_rggb8", "yuv422", "8UC4", "x", "16UC1"]),
)
def test_any_fields_give_an_image_or_an_image_error(
    data: bytes, height: int, width: int, step: int, encoding: str
) -> None:
    try:
        image = decode_image(data, height=height, width=width, encoding=encoding, step=step)
    except ImageError:
        return
    assert image.shape[:2] == (height, width)


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("shape", [(5, 7), (5, 7, 3)])
def test_files_keep_every_bit(tmp_path, dtype: type, shape: tuple[int, ...]) -> None:  # type: ignore[no-untyped-def]
    image = np.random.default_rng(0).integers(0, np.iinfo(dtype).max, shape).astype(dtype)
    write_image(tmp_path / "x.png", image)
    back = read_image(tmp_path / "x.png")
    assert back.dtype == dtype
    assert (back == image).all()
    assert [p.name for p in tmp_path.iterdir()] == ["x.png"]


def test_unreadable_files_are_named(tmp_path) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(ImageError, match=r"gone\.png"):
        read_image(tmp_path / "gone.png")
    (tmp_path / "text.png").write_text("hello")
    with pytest.raises(ImageError, match=r"text\.png: .*got 5 bytes"):
        read_image(tmp_path / "text.png")
    with pytest.raises(ImageError, match="0 bytes"):
        decode_compressed(b"")


def test_truncated_png_is_refused_or_whole() -> None:
    done, png = cv2.imencode(".png", np.zeros((40, 40, 3), np.uint8))
    assert done
    with pytest.raises(ImageError):
        decode_compressed(png.tobytes()[:20])


def test_gray_keeps_mono_and_weighs_colour() -> None:
    mono = np.full((2, 2), 9, np.uint16)
    assert to_gray(mono) is mono
    rgb = np.zeros((1, 1, 3), np.uint8)
    rgb[..., 1] = 100
    assert to_gray(rgb)[0, 0] == 59


def _with_orientation(jpeg: bytes, orientation: int) -> bytes:
    """A JPEG with an EXIF block (CIPA DC-008) that holds an orientation and nothing else."""
    tiff = b"MM\0*" + struct.pack(">IHHHIHHI", 8, 1, 0x0112, 3, 1, orientation, 0, 0)
    block = b"Exif\0\0" + tiff
    return jpeg[:2] + b"\xff\xe1" + struct.pack(">H", len(block) + 2) + block + jpeg[2:]


@pytest.mark.parametrize("colour", [False, True])
def test_a_photograph_is_upright_as_its_exif_says(colour: bool) -> None:
    rows, columns = np.mgrid[:24, :40]
    gray = (3 * rows + 2 * columns).astype(np.uint8)
    image = np.dstack([gray, gray // 2, 255 - gray]) if colour else gray
    upright: dict[int, Callable[[np.ndarray], np.ndarray]] = {
        1: lambda a: a, 2: np.fliplr, 3: lambda a: np.rot90(a, 2), 4: np.flipud, 5: lambda a: a.swapaxes(0, 1),
        6: lambda a: np.rot90(a, -1), 7: lambda a: np.rot90(a, 2).swapaxes(0, 1), 8: np.rot90,
    }  # fmt: skip
    jpeg = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, 100])[1].tobytes()
    plain = decode_compressed(jpeg)
    for orientation, turn in upright.items():
        np.testing.assert_array_equal(decode_compressed(_with_orientation(jpeg, orientation)), turn(plain))
