"""Arrays <-> image messages, on the bytes themselves."""

from __future__ import annotations

import sys
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.bounds import LARGEST_PIXELS
from uw_recon_ros.errors import ImageError
from uw_recon_ros.files.images import decode_compressed
from uw_recon_ros.images import decode_image, demosaiced
from uw_recon_ros.messages.factory import MessageFactory
from uw_recon_ros.types import FloatImage, RawImage

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
NATIVE_BIG = sys.byteorder == "big"
_ENCODINGS = {
    ("uint8", 2): "mono8",
    ("uint8", 3): "bgr8",
    ("uint16", 2): "mono16",
    ("uint16", 3): "bgr16",
    ("float32", 2): "32FC1",
}
_DEPTHS: dict[str, tuple[np.dtype[Any], float]] = {
    "32FC1": (np.dtype(np.float32), 1.0),
    "16UC1": (np.dtype(np.uint16), 0.001),
}


def raw_image_message(make: MessageFactory, array: NDArray[Any], encoding: str, head: Any) -> Any:
    """Make an image message of an array as it lies in memory, rows without padding.

    Parameters
    ----------
    make : MessageFactory
    array : (H, W) or (H, W, C)
        Already in the channel order that `encoding` names.
    encoding : str
        A name of ``sensor_msgs/image_encodings``.
    head : Header
    """
    return make(
        IMAGE, header=head, height=array.shape[0], width=array.shape[1], encoding=encoding,
        is_bigendian=int(NATIVE_BIG), step=int(array[0].size * array.itemsize), data=make.octets(array),
    )  # fmt: skip


def image_message(make: MessageFactory, image: NDArray[Any], head: Any) -> Any:
    """Make an image message.

    Parameters
    ----------
    make : MessageFactory
    image : (H, W) uint8, uint16 or float32, or (H, W, 3) uint8 or uint16
        Mono, float32 in any unit, or RGB, which is sent as BGR.
    head : Header

    Raises
    ------
    ValueError
        For any other shape or dtype.
    """
    encoding = _ENCODINGS.get((image.dtype.name, image.ndim))
    if encoding is None or (image.ndim == 3 and image.shape[2] != 3):
        raise ValueError(f"image: expected 8 or 16 bits mono or RGB, or float32 mono, got {image.dtype} {image.shape}")
    swapped = cv2.cvtColor(image, cv2.COLOR_RGB2BGR) if image.ndim == 3 else image
    return raw_image_message(make, swapped, encoding, head)


def image_from_message(message: Any, most_pixels: int = LARGEST_PIXELS) -> RawImage:
    """Decode a raw or compressed image message.

    Returns
    -------
    (H, W) or (H, W, 3) uint8 or uint16
        Mono, or RGB.

    Raises
    ------
    ImageError
        Naming the field, the expectation and what came.
    """
    if not hasattr(message, "encoding"):
        decoded = decode_compressed(message.data, most_pixels)
        return demosaiced(decoded, _lossless_mosaic(str(message.format)))
    return decode_image(
        message.data, height=message.height, width=message.width, encoding=message.encoding, step=message.step,
        is_bigendian=message.is_bigendian, most_pixels=most_pixels,
    )  # fmt: skip


def _lossless_mosaic(told: str) -> str:
    """The encoding before compression, of ``bayer_rggb8; png compressed bayer_rggb8``; JPEG mixes its colours."""
    encoding, _, transport = told.partition(";")
    return encoding.strip() if "png" in transport or "tiff" in transport else ""


def float_image_from_message(message: Any) -> FloatImage:
    """Decode a ``32FC1`` image, honouring step and byte order.

    Returns
    -------
    (H, W) float32
        May be a read-only view of the message's data.

    Raises
    ------
    ImageError
    """
    if message.encoding != "32FC1":
        raise ImageError(f"encoding: expected 32FC1, got {message.encoding[:40]!r}")
    height, width, step = message.height, message.width, message.step
    if not (height and width) or step < 4 * width:
        raise ImageError(f"32FC1 image: expected a size and a step of at least 4 x width, got {width}x{height}, {step}")
    if len(message.data) != step * height:
        raise ImageError(
            f"image data: expected step x height = {step} x {height} = {step * height} bytes, got {len(message.data)}"
        )
    rows = np.frombuffer(message.data, np.uint8).reshape(height, step)[:, : 4 * width]
    order = ">" if message.is_bigendian else "<"
    floats: FloatImage = np.ascontiguousarray(rows).view(f"{order}f4").astype(np.float32, copy=False)
    return floats


def depth_from_message(message: Any) -> FloatImage:
    """Depth in m of an Image, 32FC1 (m) or 16UC1 (mm, 0 = invalid) as REP 118 has them: NaN = invalid.

    Raises
    ------
    ImageError
    """
    if message.encoding not in _DEPTHS:
        raise ImageError(f"depth: expected {' or '.join(_DEPTHS)}, got {str(message.encoding)[:40]!r}")
    kind, unit_m = _DEPTHS[message.encoding]
    row = int(message.width) * kind.itemsize
    if message.step < row or len(message.data) != message.step * message.height:
        told = f"{len(message.data)} bytes in steps of {message.step}"
        raise ImageError(f"depth: expected {message.height} rows of at least {row} bytes, got {told}")
    rows = np.ascontiguousarray(np.frombuffer(message.data, np.uint8).reshape(message.height, message.step)[:, :row])
    values = rows.view(kind.newbyteorder(">" if message.is_bigendian else "<")).astype(np.float32)
    depth: FloatImage = np.where(np.isfinite(values) & (values > 0), values * np.float32(unit_m), np.float32(np.nan))
    return depth
