"""Images as they lie in memory and in messages -> arrays. RGB inside; OpenCV's and ROS's BGR ends here."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.bounds import LARGEST_PIXELS
from uw_recon_ros.errors import ImageError
from uw_recon_ros.types import ByteImage, RawImage

_MAX_SIDE = 65_536
_BIT_DEPTHS: dict[str, np.dtype[Any]] = {"8": np.dtype(np.uint8), "16": np.dtype(np.uint16)}
_FEWER_BITS = ("10", "12", "14")
# OpenCV names a Bayer pattern after its second row and column, ROS after the first.
_BAYER = {
    "rggb": cv2.COLOR_BayerBG2RGB,
    "bggr": cv2.COLOR_BayerRG2RGB,
    "gbrg": cv2.COLOR_BayerGR2RGB,
    "grbg": cv2.COLOR_BayerGB2RGB,
}
_YUV422 = {
    "yuv422_uyvy": cv2.COLOR_YUV2RGB_UYVY,
    "yuyv422": cv2.COLOR_YUV2RGB_YUY2,
    "yuv422_yuyv": cv2.COLOR_YUV2RGB_YUY2,
    "yuy2": cv2.COLOR_YUV2RGB_YUY2,
    "yuv422": cv2.COLOR_YUV2RGB_UYVY,
    "uyvy": cv2.COLOR_YUV2RGB_UYVY,
    "yuv422_yuy2": cv2.COLOR_YUV2RGB_YUY2,
    "yuyv": cv2.COLOR_YUV2RGB_YUY2,
}
#: Luma rows over rows of half the height with both colours.
_PLANAR = {
    "nv12": cv2.COLOR_YUV2RGB_NV12,
    "nv21": cv2.COLOR_YUV2RGB_NV21,
    "i420": cv2.COLOR_YUV2RGB_I420,
    "yv12": cv2.COLOR_YUV2RGB_YV12,
}
_COLOR_ORDER = {"rgb": [0, 1, 2], "bgr": [2, 1, 0], "rgba": [0, 1, 2], "bgra": [2, 1, 0]}
_GENERIC = re.compile(r"(8|16)UC?(1|3|4)?")

Convert = Callable[[NDArray[Any]], RawImage]


@dataclass(frozen=True)
class _Layout:
    """How one ROS encoding lies in memory and becomes mono or RGB."""

    dtype: np.dtype[Any]
    channels: int
    convert: Convert


def _first_channel(raw: NDArray[Any]) -> RawImage:
    return raw[..., 0]


def _lifted(convert: Convert, missing: int) -> Convert:
    """Values of fewer bits as if they had 16."""
    return lambda raw: convert(np.left_shift(raw, missing))


_SWAPPED = [2, 1, 0]


def _reorder(order: list[int]) -> Convert:
    def convert(raw: NDArray[Any]) -> RawImage:
        if order != _SWAPPED:
            return np.ascontiguousarray(raw[..., order])
        native = np.ascontiguousarray(raw, raw.dtype.newbyteorder("="))
        code = cv2.COLOR_BGR2RGB if raw.shape[2] == 3 else cv2.COLOR_BGRA2RGB
        return np.asarray(cv2.cvtColor(native, code))  # 40 times faster than an index

    return convert


def _opencv(code: int, squeeze: bool) -> Convert:
    return lambda raw: cv2.cvtColor(np.ascontiguousarray(raw[..., 0] if squeeze else raw), code)


def _layout(encoding: str) -> _Layout:
    """Interpret a name of ``sensor_msgs/image_encodings``."""
    if encoding.lower() in _YUV422:
        return _Layout(_BIT_DEPTHS["8"], 2, _opencv(_YUV422[encoding.lower()], squeeze=False))
    name, bits = re.sub(r"\d+$", "", encoding), encoding[len(encoding.rstrip("0123456789")) :]
    if bits in _FEWER_BITS:  # in two bytes each, the highest bits empty
        full = _layout(f"{name}16")
        return _Layout(full.dtype, full.channels, _lifted(full.convert, 16 - int(bits)))
    if bits in _BIT_DEPTHS:
        if name == "mono":
            return _Layout(_BIT_DEPTHS[bits], 1, _first_channel)
        if name in _COLOR_ORDER:
            return _Layout(_BIT_DEPTHS[bits], len(name), _reorder(_COLOR_ORDER[name]))
        if name.removeprefix("bayer_") in _BAYER and name.startswith("bayer_"):
            return _Layout(_BIT_DEPTHS[bits], 1, _opencv(_BAYER[name.removeprefix("bayer_")], squeeze=True))
    generic = _GENERIC.fullmatch(encoding)
    if generic:  # OpenCV's type names: three channels are BGR by its custom
        channels = int(generic[2] or 1)
        convert = _first_channel if channels == 1 else _reorder([2, 1, 0])
        return _Layout(_BIT_DEPTHS[generic[1]], channels, convert)
    raise ImageError(
        "encoding: expected mono8/10/12/16, rgb8/16, bgr8/16, rgba8/16, bgra8/16, bayer_*8/10/12/16, 8UC1/3, 16UC1/3, "
        f"yuv422, nv12, nv21 or i420, got {encoding[:40]!r}"
    )


def _decode_planar(data: Any, size: tuple[int, int], encoding: str, step: int, most_pixels: int) -> RawImage:
    """RGB of YUV 4:2:0; drivers count the rows of colour as height, or do not."""
    view = memoryview(data).cast("B")
    height, width = size
    if len(view) == step * height and height % 3 == 0:
        height = height * 2 // 3
    if not (0 < height <= _MAX_SIDE and 0 < width <= _MAX_SIDE) or width * height > most_pixels:
        raise ImageError(
            f"image size: expected 1 to {_MAX_SIDE} px a side, at most {most_pixels}, got {width}x{height}"
        )
    if height % 2 or width % 2 or step < width or len(view) != step * height * 3 // 2:
        raise ImageError(
            f"image data: expected even sides and step x height x 3/2 bytes of {encoding}, got {width}x{height} px, "
            f"step {step}, {len(view)} bytes"
        )
    rows = np.frombuffer(view, np.uint8).reshape(height * 3 // 2, step)
    if step != width and encoding in ("i420", "yv12"):
        raise ImageError(f"step: expected {width} bytes for {width} px of {encoding}, got {step}")
    return cv2.cvtColor(np.ascontiguousarray(rows[:, :width]), _PLANAR[encoding])


def demosaiced(mosaic: RawImage, encoding: str) -> RawImage:
    """RGB of a Bayer mosaic (H, W) by a name of ``sensor_msgs/image_encodings``; what is none comes back as it is."""
    order = encoding.removeprefix("bayer_")[:4]
    if mosaic.ndim != 2 or not encoding.startswith("bayer_") or order not in _BAYER:
        return mosaic
    return cv2.cvtColor(np.ascontiguousarray(mosaic), _BAYER[order])


def decode_image(
    data: Any,
    *,
    height: int,
    width: int,
    encoding: str,
    step: int,
    is_bigendian: bool | int = False,
    most_pixels: int = LARGEST_PIXELS,
) -> RawImage:
    """Turn the fields of a ``sensor_msgs/Image`` into an array.

    Parameters
    ----------
    data : bytes-like
        ``step * height`` bytes.
    height, width : int
        px.
    encoding : str
        A name of ``sensor_msgs/image_encodings``: mono, RGB(A), BGR(A), Bayer, generic 8U/16U, or YUV 4:2:2.
    step : int
        Bytes from row to row, padding included.
    is_bigendian : bool
        Byte order of 16-bit data.
    most_pixels : int
        It may have.

    Returns
    -------
    (H, W) or (H, W, 3) uint8 or uint16
        Mono, or RGB. May be a read-only view of `data`.

    Raises
    ------
    ImageError
        Naming the field, the expectation and what came.
    """
    if encoding.lower() in _PLANAR:
        return _decode_planar(data, (height, width), encoding.lower(), step, most_pixels)
    layout = _layout(encoding)
    if not (0 < height <= _MAX_SIDE and 0 < width <= _MAX_SIDE):
        raise ImageError(f"image size: expected 1 to {_MAX_SIDE} px a side, got {width}x{height}")
    if width * height > most_pixels:
        raise ImageError(f"image size: expected at most {most_pixels} px, got {width}x{height} = {width * height}")
    row_bytes = width * layout.channels * layout.dtype.itemsize
    if step < row_bytes:
        raise ImageError(f"step: expected at least {row_bytes} bytes for {width} px of {encoding}, got {step}")
    view = memoryview(data).cast("B")
    if len(view) != step * height:
        raise ImageError(
            f"image data: expected step x height = {step} x {height} = {step * height} bytes, got {len(view)}"
        )
    if layout.channels == 2 and width % 2:
        raise ImageError(f"width: expected an even number of px for {encoding}, got {width}")
    rows = np.frombuffer(view, np.uint8).reshape(height, step)[:, :row_bytes]
    if layout.dtype.itemsize == 2:
        rows = np.ascontiguousarray(rows)
    raw = rows.view(layout.dtype.newbyteorder(">" if is_bigendian else "<"))
    return layout.convert(raw.astype(layout.dtype, copy=False).reshape(height, width, layout.channels))


def to_gray(image: RawImage) -> RawImage:
    """Luma (ITU-R BT.601) of an RGB image; a mono image is returned as it is.

    Parameters
    ----------
    image : (H, W) or (H, W, 3) uint8 or uint16

    Returns
    -------
    (H, W), same dtype
    """
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_RGB2GRAY)


def as_gray(image: RawImage) -> ByteImage:
    """(H, W) uint8 of an image as it came."""
    gray = to_gray(image)
    return gray if gray.dtype == np.uint8 else np.asarray(gray >> 8, np.uint8)
