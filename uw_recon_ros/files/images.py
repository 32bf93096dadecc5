"""Encoded images (JPEG, PNG, TIFF ...), as bytes and as files <-> arrays. RGB inside; OpenCV's BGR ends here."""

from __future__ import annotations

import io
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError

from uw_recon_ros.bounds import LARGEST_IMAGE_FILE, LARGEST_PIXELS
from uw_recon_ros.errors import ImageError
from uw_recon_ros.files.atomic import write_bytes
from uw_recon_ros.files.bounded import read_bounded
from uw_recon_ros.files.image_header import declared_size, pixels_only
from uw_recon_ros.files.raw_photographs import SUFFIXES as PHOTOGRAPHS
from uw_recon_ros.files.raw_photographs import photograph_size, read_photograph
from uw_recon_ros.types import RawImage


def decode_any(data: Any, most_pixels: int = LARGEST_PIXELS) -> NDArray[Any]:
    """Decode an encoded image of any depth, as OpenCV does, within `bounds`; a photograph upright, as its EXIF says.

    Raises
    ------
    ImageError
    """
    encoded = memoryview(data).cast("B")
    if not len(encoded):
        raise ImageError("compressed image: expected JPEG or PNG data, got 0 bytes")
    width, height = declared_size(encoded, most_pixels)
    _check_tiff(encoded)
    try:
        image = cv2.imdecode(np.frombuffer(pixels_only(encoded), np.uint8), _decoder_flags(encoded))
    except (cv2.error, MemoryError) as error:
        raise ImageError(f"compressed image: {len(encoded)} bytes refused by the decoder") from error
    if image is None or image.shape[:2] not in ((height, width), (width, height)):  # EXIF may turn it
        raise ImageError(f"compressed image: {width}x{height} px declared, {len(encoded)} bytes damaged or cut short")
    return image


def _check_tiff(encoded: memoryview) -> None:
    """OpenCV goes on where packed pixels of 8 bits are damaged; Pillow tells, and of Deflate its own checksum does."""
    if bytes(encoded[:4]) not in (b"II\x2a\0", b"MM\0\x2a"):
        return
    try:
        with Image.open(io.BytesIO(encoded)) as opened:
            packed = opened.info.get("compression", "raw")
            if packed in ("tiff_adobe_deflate", "tiff_deflate"):
                _check_deflate(encoded, opened.tag_v2, opened.width * opened.height)
            elif packed != "raw":
                opened.load()
    except UnidentifiedImageError:  # kinds it does not know, such as 16 bits in colour: OpenCV refuses damaged ones
        return
    except (OSError, ValueError, SyntaxError, LookupError, TypeError, zlib.error) as error:
        raise ImageError(f"compressed image: {len(encoded)} bytes, damaged: the pixels cannot be unpacked") from error


def _check_deflate(encoded: memoryview, tags: Mapping[int, Any], pixels: int) -> None:
    offsets, counts = (324, 325) if 324 in tags else (273, 279)
    for start, count in zip(tags[offsets], tags[counts], strict=True):
        unpacked = zlib.decompressobj()
        unpacked.decompress(encoded[start : start + count], 16 * pixels + 2**20)
        if not unpacked.eof:
            raise ValueError("a part of the image is cut short")


def _decoder_flags(encoded: memoryview) -> int:
    """A camera mounted upside down says so in its JPEG: obeyed, as cv_bridge and every viewer do."""
    is_jpeg = bytes(encoded[:2]) == b"\xff\xd8"
    return cv2.IMREAD_ANYCOLOR | cv2.IMREAD_ANYDEPTH if is_jpeg else cv2.IMREAD_UNCHANGED


def decode_compressed(data: Any, most_pixels: int = LARGEST_PIXELS) -> RawImage:
    """Decode the bytes of a ``sensor_msgs/CompressedImage`` or an image file (JPEG, PNG, TIFF ...).

    Parameters
    ----------
    data : bytes-like
    most_pixels : int
        It may have; at most `bounds.LARGEST_PIXELS`.

    Returns
    -------
    (H, W) or (H, W, 3) uint8 or uint16
        Mono, or RGB.

    Raises
    ------
    ImageError
    """
    image = decode_any(data, most_pixels)
    if image.dtype not in (np.uint8, np.uint16):
        raise ImageError(f"compressed image: expected 8 or 16 bits a channel, got {image.dtype}")
    if image.ndim == 2:
        return image
    if image.shape[2] == 1:
        return image[..., 0]
    return np.ascontiguousarray(image[..., 2::-1])


def read_image(path: str | Path) -> RawImage:
    """Read an image file as mono or RGB, 8 or 16 bits; raw photographs and HEIC with the extra ``raw``.

    Raises
    ------
    ImageError
        It is missing, unreadable or not an image; the text names the file.
    """
    suffix = Path(path).suffix.lower()
    try:
        data = read_bounded(path, LARGEST_IMAGE_FILE, ImageError)
        return read_photograph(data, suffix) if _is_photograph(data, suffix) else decode_compressed(data)
    except ImageError as error:
        raise _of_file(path, error) from error


def image_size(path: str | Path) -> tuple[int, int]:
    """Width and height, px, of an image file; it is read whole, so that one cut short is noticed, but not decoded.

    Raises
    ------
    ImageError
        As `read_image`, as far as the header and the end of the file tell.
    """
    suffix = Path(path).suffix.lower()
    try:
        data = read_bounded(path, LARGEST_IMAGE_FILE, ImageError)
        return photograph_size(data, suffix) if _is_photograph(data, suffix) else declared_size(memoryview(data))
    except ImageError as error:
        raise _of_file(path, error) from error


def _is_photograph(data: bytes, suffix: str) -> bool:
    """Whether it is for LibRaw or libheif: by its name, unless it is a JPEG that was only renamed."""
    return suffix in PHOTOGRAPHS and not data.startswith(b"\xff\xd8\xff")


def _of_file(path: str | Path, error: ImageError) -> ImageError:
    told = str(error).removeprefix("compressed image: ")
    return ImageError(f"{path}: expected an image file: {told}", error.code)


def write_image(path: str | Path, image: RawImage) -> None:
    """Write mono or RGB to a file, whole or not at all.

    Parameters
    ----------
    path : path
        Its suffix chooses the format.
    image : (H, W) or (H, W, 3) uint8 or uint16 (float32 mono for TIFF)
    """
    path = Path(path)
    swapped = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    done, encoded = cv2.imencode(path.suffix, swapped)
    if not done:
        raise ImageError(f"{path}: {image.dtype} {image.shape} cannot be written as {path.suffix}")
    write_bytes(path, encoded.tobytes())
