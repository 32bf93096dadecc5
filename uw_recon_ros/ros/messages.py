"""Images and stamps <-> messages, on the bytes themselves."""

from __future__ import annotations

import sys
from typing import Any

import cv2
import numpy as np
from builtin_interfaces.msg import Time
from numpy.typing import NDArray
from sensor_msgs.msg import CompressedImage, Image
from std_msgs.msg import Header

from uw_recon_ros.errors import ImageError, MessageError
from uw_recon_ros.images import decode_compressed, decode_image
from uw_recon_ros.types import ByteImage, FloatImage, RawImage

_BILLION = 1_000_000_000
_LONGEST_FRAME_ID = 255
_NATIVE_BIG = sys.byteorder == "big"


def stamp_ns(message: Any) -> int:
    """Header stamp of a message, ns."""
    stamp = message.header.stamp
    return int(stamp.sec) * _BILLION + int(stamp.nanosec)


def received_stamp_ns(message: Any) -> int:
    """Header stamp of a message that came from elsewhere, ns.

    Raises
    ------
    MessageError
        The stamp is no time, or the frame's name no name: neither may travel on.
    """
    stamp, frame_id = message.header.stamp, message.header.frame_id
    if stamp.sec < 0 or stamp.nanosec >= _BILLION:
        raise MessageError(
            f"stamp: expected sec >= 0 and nanosec < {_BILLION}, got sec {stamp.sec}, nanosec {stamp.nanosec}"
        )
    if len(frame_id) > _LONGEST_FRAME_ID or not frame_id.isprintable():
        raise MessageError(
            f"frame_id: expected at most {_LONGEST_FRAME_ID} printable characters, got {len(frame_id)}: "
            f"{frame_id[:40]!a}"
        )
    return stamp_ns(message)


def time_message(nanoseconds: int) -> Time:
    """Turn ns into a ``builtin_interfaces/Time``.

    Raises
    ------
    ValueError
        Beyond what a Time holds (32 bits of seconds).
    """
    seconds, rest = divmod(nanoseconds, _BILLION)
    if not -(2**31) <= seconds < 2**31:
        raise ValueError(f"stamp: expected seconds within 32 bits, got {seconds}")
    return Time(sec=seconds, nanosec=rest)


def header(nanoseconds: int, frame_id: str) -> Header:
    """Make a header, stamp in ns."""
    return Header(stamp=time_message(nanoseconds), frame_id=frame_id)


def fill(message: Any, array: NDArray[Any]) -> None:
    """Copy an array's bytes into ``message.data``, which must still be empty.

    Assigning an array to ``data`` converts it element by element, seconds for a cloud; `frombytes` is one copy.
    """
    if array.size:
        message.data.frombytes(memoryview(np.ascontiguousarray(array).data).cast("B"))


def image_from_message(message: Image | CompressedImage) -> RawImage:
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
    if isinstance(message, CompressedImage):
        return decode_compressed(message.data)
    return decode_image(
        message.data, height=message.height, width=message.width, encoding=message.encoding, step=message.step,
        is_bigendian=message.is_bigendian,
    )  # fmt: skip


def float_image_from_message(message: Image) -> FloatImage:
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


def image_message(array: NDArray[Any], encoding: str, head: Header) -> Image:
    """Make an image message of an array as it lies in memory, rows without padding.

    Parameters
    ----------
    array : (H, W) or (H, W, C)
        Already in the channel order `encoding` names.
    encoding : str
        A name of ``sensor_msgs/image_encodings``.
    head : Header
    """
    message = Image(header=head, height=array.shape[0], width=array.shape[1], encoding=encoding)
    message.step = int(array[0].size * array.itemsize)
    message.is_bigendian = int(_NATIVE_BIG)
    fill(message, array)
    return message


def color_message(image: ByteImage, head: Header) -> Image:
    """Make a ``bgr8`` message of an (H, W, 3) uint8 RGB image."""
    return image_message(cv2.cvtColor(image, cv2.COLOR_RGB2BGR), "bgr8", head)


def mono_message(image: ByteImage, head: Header) -> Image:
    """Make a ``mono8`` message of an (H, W) uint8 image."""
    return image_message(image, "mono8", head)


def float_message(image: FloatImage, head: Header) -> Image:
    """Make a ``32FC1`` message of an (H, W) float32 image."""
    return image_message(image, "32FC1", head)
