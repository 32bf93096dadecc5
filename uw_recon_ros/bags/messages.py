"""The messages room with the classes of bags, without ROS: the CDR work is rosbags'."""

from __future__ import annotations

import struct
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.interfaces import Nodetype
from rosbags.serde import SerdeError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from uw_recon_ros.bags.model import RawMessage
from uw_recon_ros.errors import BagError
from uw_recon_ros.messages import cameras, images, poses
from uw_recon_ros.messages.cameras import CAMERA_INFO
from uw_recon_ros.messages.clouds import marker_without_corners
from uw_recon_ros.messages.headers import header, stamp_ns
from uw_recon_ros.messages.images import COMPRESSED_IMAGE, IMAGE, depth_from_message, image_from_message
from uw_recon_ros.topics import FFMPEG_PACKET, FOXGLOVE_VIDEO, H264_PACKET
from uw_recon_ros.types import CameraModel, Surface

__all__ = [
    "CAMERA_INFO", "COMPRESSED_IMAGE", "FFMPEG_PACKET", "FOXGLOVE_VIDEO", "H264_PACKET", "IMAGE", "IMAGES", "MAKE",
    "VIDEOS", "BagFactory", "camera_info_message", "decode", "depth_from_message", "encode", "encode_surface",
    "image_from_message", "image_message", "pose_message", "stamp_ns", "typestore",
]  # fmt: skip


#: Encoded video, a packet a message; both begin with a stamp and a frame's name, as a header does.
VIDEOS = (FOXGLOVE_VIDEO, FFMPEG_PACKET, H264_PACKET)
#: All types that hold images.
IMAGES = (IMAGE, COMPRESSED_IMAGE, *VIDEOS)
_DEFINITIONS = {
    FOXGLOVE_VIDEO: "builtin_interfaces/Time timestamp\nstring frame_id\nuint8[] data\nstring format\n",
    FFMPEG_PACKET: "std_msgs/Header header\nint32 width\nint32 height\nstring encoding\nuint64 pts\nuint8 flags\n"
    "bool is_bigendian\nuint8[] data\n",
    H264_PACKET: "std_msgs/Header header\nint64 seq\nuint8[] data\n",
    f"{H264_PACKET}Short": "std_msgs/Header header\nint32 seq\nuint8[] data\n",
    f"{H264_PACKET}Plain": "std_msgs/Header header\nuint8[] data\n",
}
#: What a type was earlier, under the same name; of one's bytes the others are too long or too short.
_EARLIER = {H264_PACKET: (f"{H264_PACKET}Short", f"{H264_PACKET}Plain")}
_UNFIT = (SerdeError, KeyError, ValueError, AssertionError, IndexError, OverflowError, struct.error)


@cache
def typestore() -> Typestore:
    """Definitions of the standard messages, and of those that hold video."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for name, text in _DEFINITIONS.items():
        store.register(get_types_from_msg(text, name))
    return store


def decode(message: RawMessage) -> Any:
    """Turn CDR into a message object with the fields of the ROS type.

    Raises
    ------
    BagError
        The type is not a standard one or the bytes do not fit it.
    """
    problem = ""  # not the error itself: it would keep this frame, and all that was read in it, alive
    for kind in (message.type, *_EARLIER.get(message.type, ())):
        try:
            return typestore().deserialize_cdr(message.data, kind)
        except _UNFIT as error:
            problem = problem or str(error)
    raise BagError(f"{message.topic}: {len(message.data)} bytes are no {message.type} ({problem})")


class BagFactory:
    """Makes the messages that bags are written from; see `uw_recon_ros.messages.factory`."""

    def __call__(self, type_name: str, **fields: Any) -> Any:
        """Make a message; fields that are not given are zero or empty."""
        missing = {name: kind for name, kind in typestore().fielddefs[type_name][1] if name not in fields}
        return typestore().types[type_name](**fields, **{name: self._empty(kind) for name, kind in missing.items()})

    def octets(self, array: NDArray[Any]) -> Any:
        """Bytes of an array, rows one after the other."""
        return np.ascontiguousarray(array).reshape(-1).view(np.uint8)

    def doubles(self, array: NDArray[Any]) -> Any:
        """Numbers of an array."""
        return np.asarray(array, np.float64).ravel()

    def floats(self, array: NDArray[Any]) -> Any:
        """Numbers of an array."""
        return np.asarray(array, np.float32).ravel()

    def _empty(self, kind: Any) -> Any:
        node, inner = kind
        if node is Nodetype.BASE:
            return "" if inner[0] == "string" else np.zeros(1, inner[0])[0].item()
        if node is Nodetype.NAME:
            return self(inner)
        (element, name), count = inner
        if element is not Nodetype.BASE or name[0] == "string":
            return [self._empty((element, name)) for _ in range(count if node is Nodetype.ARRAY else 0)]
        return np.zeros(count if node is Nodetype.ARRAY else 0, name[0])


#: The one there needs to be.
MAKE = BagFactory()


def image_message(image: NDArray[Any], *, time_ns: int, frame_id: str) -> Any:
    """Image message of an array, mono or RGB, see `messages.images.image_message`; `time_ns` is the header stamp."""
    return images.image_message(MAKE, image, header(MAKE, time_ns, frame_id))


def camera_info_message(camera: CameraModel, *, time_ns: int, frame_id: str) -> Any:
    """CameraInfo message of a camera."""
    return cameras.camera_info_message(MAKE, camera, header(MAKE, time_ns, frame_id))


def pose_message(position: NDArray[Any], quaternion: NDArray[Any], *, time_ns: int, frame_id: str) -> Any:
    """PoseStamped of a position (3,) in m and a unit quaternion (4,) x, y, z, w."""
    return poses.pose_message(MAKE, position, quaternion, header(MAKE, time_ns, frame_id))


def encode(message: Any) -> tuple[str, bytes]:
    """Type name and CDR bytes of a message object."""
    name = str(message.__msgtype__)
    return name, bytes(typestore().serialize_cdr(message, name))


def encode_surface(surface: Surface) -> tuple[str, bytes]:
    """Type name and CDR bytes of `messages.clouds.surface_message`.

    The serialiser takes a second for a hundred thousand corners as objects, so they are put in as arrays: a marker is
    serialised without them, and opened where they belong (lists of 8-byte, then of 4-byte numbers, after their counts).
    """
    marker = marker_without_corners(MAKE, surface)
    kind, without = encode(marker)
    marker.points = [MAKE("geometry_msgs/msg/Point")]
    with_one = encode(marker)[1]
    place = next(i for i, (a, b) in enumerate(zip(without, with_one, strict=False)) if a != b)
    corners = surface.faces.ravel()
    count = struct.pack("<I", len(corners))
    if not len(corners):
        return kind, without
    padding = bytes(-(place + 4 - 4) % 8)  # 4 for the count, less 4 of the encapsulation, which alignment leaves out
    points = np.ascontiguousarray(surface.vertices[corners], "<f8").tobytes()
    colors = np.ones((len(corners), 4), "<f4")
    colors[:, :3] = surface.colors[corners] / 255.0
    return kind, b"".join([without[:place], count, padding, points, count, colors.tobytes(), without[place + 8 :]])
