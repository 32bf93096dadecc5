"""Recorded messages <-> arrays and the project's nouns, without ROS: the CDR work is rosbags'."""

from __future__ import annotations

import struct
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from uw_recon_ros.bags.model import RawMessage
from uw_recon_ros.errors import BagError, ImageError
from uw_recon_ros.images import decode_compressed, decode_image
from uw_recon_ros.types import CameraModel, FloatImage, RawImage

IMAGE = "sensor_msgs/msg/Image"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
POSE = "geometry_msgs/msg/PoseStamped"

_NS = 1_000_000_000


@cache
def typestore() -> Typestore:
    """Definitions of the standard messages."""
    return get_typestore(Stores.ROS2_JAZZY)


def decode(message: RawMessage) -> Any:
    """Turn CDR into a message object with the fields of the ROS type.

    Raises
    ------
    BagError
        The type is not a standard one or the bytes do not fit it.
    """
    try:
        return typestore().deserialize_cdr(message.data, message.type)
    except (SerdeError, KeyError, ValueError, AssertionError, IndexError, OverflowError, struct.error) as error:
        raise BagError(f"{message.topic}: {len(message.data)} bytes are no {message.type} ({error})") from error


def stamp_ns(message: Any) -> int:
    """Header stamp of a decoded message, ns."""
    stamp = message.header.stamp
    return int(stamp.sec) * _NS + int(stamp.nanosec)


def image_from_message(message: Any) -> RawImage:
    """Array of a decoded Image or CompressedImage: mono or RGB.

    Raises
    ------
    ImageError
    """
    if not hasattr(message, "encoding"):
        return decode_compressed(message.data)
    return decode_image(
        message.data, height=message.height, width=message.width, encoding=message.encoding, step=message.step,
        is_bigendian=message.is_bigendian,
    )  # fmt: skip


_DEPTHS: dict[str, tuple[np.dtype[Any], float]] = {
    "32FC1": (np.dtype(np.float32), 1.0),
    "16UC1": (np.dtype(np.uint16), 0.001),
}


def depth_from_message(message: Any) -> FloatImage:
    """Depth in m of a decoded Image, 32FC1 (m) or 16UC1 (mm, 0 = invalid) as REP 118 has them: NaN = invalid.

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
    rows = np.ascontiguousarray(np.asarray(message.data).reshape(message.height, message.step)[:, :row])
    values = rows.view(kind.newbyteorder(">" if message.is_bigendian else "<")).astype(np.float32)
    depth: FloatImage = np.where(np.isfinite(values) & (values > 0), values * np.float32(unit_m), np.float32(np.nan))
    return depth


def _message_class(type_name: str) -> Any:
    return typestore().types[type_name]


def _header(time_ns: int, frame_id: str) -> Any:
    time = _message_class("builtin_interfaces/msg/Time")(sec=time_ns // _NS, nanosec=time_ns % _NS)
    return _message_class("std_msgs/msg/Header")(stamp=time, frame_id=frame_id)


_ENCODINGS = {
    ("uint8", 2): "mono8",
    ("uint8", 3): "bgr8",
    ("uint16", 2): "mono16",
    ("uint16", 3): "bgr16",
    ("float32", 2): "32FC1",
}


def image_message(image: NDArray[Any], *, time_ns: int, frame_id: str) -> Any:
    """Image message of an array.

    Parameters
    ----------
    image : (H, W) uint8, uint16 or float32, or (H, W, 3) uint8 or uint16
        Mono, depth in m, or RGB (recorded as BGR).
    time_ns : int
        Header stamp, ns.
    frame_id : str
    """
    encoding = _ENCODINGS.get((image.dtype.name, image.ndim))
    if encoding is None or (image.ndim == 3 and image.shape[2] != 3):
        raise ValueError(f"image: expected 8 or 16 bits mono or RGB, or float32 mono, got {image.dtype} {image.shape}")
    swapped = np.ascontiguousarray(image[..., ::-1] if image.ndim == 3 else image)
    swapped = swapped.astype(swapped.dtype.newbyteorder("<"), copy=False)
    return _message_class(IMAGE)(
        header=_header(time_ns, frame_id), height=image.shape[0], width=image.shape[1], encoding=encoding,
        is_bigendian=0, step=swapped.strides[0], data=swapped.reshape(-1).view(np.uint8),
    )  # fmt: skip


def camera_info_message(camera: CameraModel, *, time_ns: int, frame_id: str) -> Any:
    """CameraInfo message of a camera."""
    region = _message_class("sensor_msgs/msg/RegionOfInterest")(
        x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
    )
    return _message_class(CAMERA_INFO)(
        header=_header(time_ns, frame_id), height=camera.height, width=camera.width,
        distortion_model=camera.distortion_model, d=np.asarray(camera.d, np.float64).ravel(),
        k=np.asarray(camera.k, np.float64).ravel(), r=np.asarray(camera.r, np.float64).ravel(),
        p=np.asarray(camera.p, np.float64).ravel(), binning_x=0, binning_y=0, roi=region,
    )  # fmt: skip


def pose_message(position: NDArray[Any], quaternion: NDArray[Any], *, time_ns: int, frame_id: str) -> Any:
    """PoseStamped of a position (3,) in m and a unit quaternion (4,) x, y, z, w."""
    x, y, z = (float(value) for value in position)
    qx, qy, qz, qw = (float(value) for value in quaternion)
    pose = _message_class("geometry_msgs/msg/Pose")(
        position=_message_class("geometry_msgs/msg/Point")(x=x, y=y, z=z),
        orientation=_message_class("geometry_msgs/msg/Quaternion")(x=qx, y=qy, z=qz, w=qw),
    )
    return _message_class(POSE)(header=_header(time_ns, frame_id), pose=pose)


def encode(message: Any) -> tuple[str, bytes]:
    """Type name and CDR bytes of a message object."""
    name = str(message.__msgtype__)
    return name, bytes(typestore().serialize_cdr(message, name))
