"""Messages of the nodes' outputs as CDR, made without ROS; a test compares each with the nodes' byte by byte."""

from __future__ import annotations

import math
import struct
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.bags import messages
from uw_recon_ros.types import (
    ByteImage,
    CameraModel,
    DisparityMap,
    Matrix,
    PointCloud,
    RectifiedPair,
    StereoGeometry,
    Surface,
    Window,
)

_POINT_STEP = 16
_FLOAT32 = 7  # sensor_msgs/PointField's number
_TRIANGLE_LIST, _ADD, _DELETE = 11, 0, 2  # visualization_msgs/Marker's


def _type(name: str) -> Any:
    return messages.typestore().types[name]


def _header(time_ns: int, frame_id: str) -> Any:
    seconds, rest = divmod(time_ns, 1_000_000_000)
    time = _type("builtin_interfaces/msg/Time")(sec=seconds, nanosec=rest)
    return _type("std_msgs/msg/Header")(stamp=time, frame_id=frame_id)


def ideal_camera(intrinsics: Matrix, shape: tuple[int, ...]) -> CameraModel:
    """A camera without distortion or rotation, (3, 3) `intrinsics`, for images of `shape`."""
    p = np.hstack([intrinsics, np.zeros((3, 1))])
    return CameraModel(shape[1], shape[0], intrinsics, np.zeros(5), np.eye(3), p)


def rectified_cameras(pair: RectifiedPair) -> list[tuple[CameraModel, Window | None]]:
    """Both rectified views, each with its window: left ``R`` undoes nothing but names the rotation that was applied."""
    geometry = pair.geometry
    left = replace(
        ideal_camera(geometry.intrinsics_left, pair.left.shape), r=np.asarray(geometry.rect_from_raw_left, np.float64)
    )
    along = 0 if geometry.axis == "horizontal" else 1
    intrinsics = geometry.intrinsics_left
    intrinsics[along, 2] = geometry.cx_right
    right = ideal_camera(intrinsics, pair.left.shape)
    right.p[along, 3] = _shift(geometry)
    return [(left, pair.valid_left), (right, pair.valid_right)]


def _shift(geometry: StereoGeometry) -> float:
    """``-f B``; NaN with the baseline's sign where it is not known, as the nodes have it."""
    if geometry.baseline_m is None:
        return math.copysign(math.nan, geometry.baseline_sign)
    return -geometry.focal_px * geometry.baseline_m


def info_bytes(camera: CameraModel, window: Window | None, head: dict[str, Any]) -> tuple[str, bytes]:
    """A CameraInfo whose region of interest is the window, where there is one."""
    message = messages.camera_info_message(camera, **head)
    if window is not None:
        message.roi.x_offset, message.roi.y_offset = window.u, window.v
        message.roi.width, message.roi.height = window.width, window.height
    return messages.encode(message)


def disparity_bytes(disparity: DisparityMap, head: dict[str, Any]) -> tuple[str, bytes]:
    """A ``stereo_msgs/DisparityImage`` of the disparities as they are, invalid = NaN: the nodes' default."""
    geometry, values = disparity.geometry, disparity.disparity
    valid = values[np.isfinite(values)]
    whole = np.array_equal(valid, np.rint(valid))
    region = _type("sensor_msgs/msg/RegionOfInterest")(
        x_offset=0, y_offset=0, height=values.shape[0], width=values.shape[1], do_rectify=False
    )
    return messages.encode(
        _type("stereo_msgs/msg/DisparityImage")(
            header=_header(**head),
            image=messages.image_message(values, **head),
            f=float(geometry.focal_px),
            t=math.nan if geometry.baseline_m is None else float(geometry.baseline_m),
            valid_window=region,
            min_disparity=float(valid.min(initial=disparity.min_disparity)),
            max_disparity=float(valid.max(initial=disparity.max_disparity)),
            delta_d=1.0 if whole else 1.0 / 16.0,
        )
    )


def cloud_bytes(cloud: PointCloud) -> tuple[str, bytes]:
    """A ``PointCloud2`` of x, y, z, rgb float32, organised where the cloud is."""
    points = cloud.points if cloud.points.ndim == 3 else cloud.points[np.newaxis]
    height, width = points.shape[:2]
    table = np.empty((height, width, 4), "<f4")
    table[..., :3] = points
    table[..., 3] = _packed(cloud.colors.reshape(points.shape))
    field = _type("sensor_msgs/msg/PointField")
    names = ("x", "y", "z", "rgb")
    return messages.encode(
        _type("sensor_msgs/msg/PointCloud2")(
            header=_header(cloud.stamp_ns, cloud.frame_id),
            height=height,
            width=width,
            fields=[field(name=n, offset=4 * i, datatype=_FLOAT32, count=1) for i, n in enumerate(names)],
            is_bigendian=False,
            point_step=_POINT_STEP,
            row_step=_POINT_STEP * width,
            data=table.reshape(-1).view(np.uint8),
            is_dense=cloud.points.ndim == 2,
        )
    )


def _packed(colors: ByteImage) -> NDArray[np.float32]:
    """``0x00RRGGBB``, the bits named a float32."""
    r, g, b = (colors[..., i].astype(np.uint32) for i in range(3))
    packed: NDArray[np.float32] = (r << np.uint32(16) | g << np.uint32(8) | b).view(np.float32)
    return packed


def surface_bytes(surface: Surface) -> tuple[str, bytes]:
    """A ``TRIANGLE_LIST`` marker with a colour at every corner.

    The serialiser takes a second for a hundred thousand corners as objects, so they are put in as arrays: a marker is
    serialised without them, and opened where they belong (lists of 8-byte, then of 4-byte numbers, after their counts).
    """
    kind, without = messages.encode(_marker(surface, []))
    origin = _type("geometry_msgs/msg/Point")(x=0.0, y=0.0, z=0.0)
    with_one = messages.encode(_marker(surface, [origin]))[1]
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


def _marker(surface: Surface, points: list[Any]) -> Any:
    zero, number = {"x": 0.0, "y": 0.0, "z": 0.0}, {"r": 1.0, "g": 1.0, "b": 1.0, "a": 1.0}
    pose = _type("geometry_msgs/msg/Pose")(
        position=_type("geometry_msgs/msg/Point")(**zero),
        orientation=_type("geometry_msgs/msg/Quaternion")(**zero, w=1.0),
    )
    nothing = np.zeros(0, np.uint8)
    return _type("visualization_msgs/msg/Marker")(
        header=_header(surface.stamp_ns, surface.frame_id),
        ns="surface" if surface.metric else "surface_unscaled",
        id=0,
        type=_TRIANGLE_LIST,
        action=_ADD if len(surface.faces) else _DELETE,
        pose=pose,
        scale=_type("geometry_msgs/msg/Vector3")(x=1.0, y=1.0, z=1.0),
        color=_type("std_msgs/msg/ColorRGBA")(**number),
        lifetime=_type("builtin_interfaces/msg/Duration")(sec=0, nanosec=0),
        frame_locked=False,
        points=points,
        colors=[],
        texture_resource="",
        texture=_type("sensor_msgs/msg/CompressedImage")(header=_header(0, ""), format="", data=nothing),
        uv_coordinates=[],
        text="",
        mesh_resource="",
        mesh_file=_type("visualization_msgs/msg/MeshFile")(filename="", data=nothing),
        mesh_use_embedded_materials=False,
    )
