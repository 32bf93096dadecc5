"""Depth, clouds and surfaces -> messages."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from uw_recon_ros.messages.cameras import camera_info_message, ideal_camera
from uw_recon_ros.messages.factory import MessageFactory
from uw_recon_ros.messages.headers import header
from uw_recon_ros.messages.images import NATIVE_BIG, image_message
from uw_recon_ros.types import ByteImage, DepthMap, PointCloud, Surface

CLOUD = "sensor_msgs/msg/PointCloud2"
MARKER = "visualization_msgs/msg/Marker"
_FLOAT32 = 7  # sensor_msgs/PointField's number
_POINT_STEP = 16
_TRIANGLE_LIST, _ADD, _DELETE = 11, 0, 2  # visualization_msgs/Marker's


def pack_rgb(colors: ByteImage) -> NDArray[np.float32]:
    """Pack RGB as RViz and PCL read it: ``0x00RRGGBB``, the bits named a float32.

    Parameters
    ----------
    colors : (..., 3) uint8

    Returns
    -------
    (...) float32
    """
    r, g, b = (colors[..., i].astype(np.uint32) for i in range(3))
    packed: NDArray[np.float32] = (r << np.uint32(16) | g << np.uint32(8) | b).view(np.float32)
    return packed


def cloud_message(make: MessageFactory, cloud: PointCloud) -> Any:
    """Make a ``PointCloud2`` of x, y, z, rgb float32.

    An (H, W, 3) cloud becomes an organised one that may hold NaN (``is_dense`` false), an (N, 3) cloud one row.
    """
    points = cloud.points if cloud.points.ndim == 3 else cloud.points[np.newaxis]
    height, width = points.shape[:2]
    table = np.empty((height, width, 4), np.float32)
    table[..., :3] = points
    table[..., 3] = pack_rgb(cloud.colors.reshape(points.shape))
    fields = [
        make("sensor_msgs/msg/PointField", name=name, offset=4 * i, datatype=_FLOAT32, count=1)
        for i, name in enumerate(("x", "y", "z", "rgb"))
    ]
    return make(
        CLOUD, header=header(make, cloud.stamp_ns, cloud.frame_id), height=height, width=width, fields=fields,
        is_bigendian=NATIVE_BIG, point_step=_POINT_STEP, row_step=_POINT_STEP * width, data=make.octets(table),
        is_dense=cloud.points.ndim == 2,
    )  # fmt: skip


def depth_messages(make: MessageFactory, depth: DepthMap) -> tuple[Any, Any, Any]:
    """Make ``depth/image_rect``, ``depth/sigma`` and ``depth/camera_info`` (REP 118)."""
    head = header(make, depth.stamp_ns, depth.frame_id)
    height, width = depth.depth.shape
    info = camera_info_message(make, ideal_camera(depth.geometry.intrinsics_left, (width, height)), head)
    return image_message(make, depth.depth, head), image_message(make, depth.sigma, head), info


def surface_message(make: MessageFactory, surface: Surface) -> Any:
    """Make a ``TRIANGLE_LIST`` marker with a colour at every corner.

    Its name space is ``surface``, or ``surface_unscaled`` where the unit is not the metre. An empty surface deletes
    the one before.
    """
    marker = marker_without_corners(make, surface)
    corners = surface.faces.ravel().tolist()
    points = [make("geometry_msgs/msg/Point", x=x, y=y, z=z) for x, y, z in surface.vertices.astype(float).tolist()]
    colors = [make("std_msgs/msg/ColorRGBA", r=r, g=g, b=b, a=1.0) for r, g, b in (surface.colors / 255.0).tolist()]
    marker.points = [points[i] for i in corners]  # corners share their vertex's object: 6 times fewer to make
    marker.colors = [colors[i] for i in corners]
    return marker


def marker_without_corners(make: MessageFactory, surface: Surface) -> Any:
    """The marker of a surface, its corners left out."""
    upright = make("geometry_msgs/msg/Quaternion", x=0.0, y=0.0, z=0.0, w=1.0)
    return make(
        MARKER, header=header(make, surface.stamp_ns, surface.frame_id), type=_TRIANGLE_LIST,
        ns="surface" if surface.metric else "surface_unscaled", action=_ADD if len(surface.faces) else _DELETE,
        pose=make("geometry_msgs/msg/Pose", orientation=upright),
        scale=make("geometry_msgs/msg/Vector3", x=1.0, y=1.0, z=1.0),
        color=make("std_msgs/msg/ColorRGBA", r=1.0, g=1.0, b=1.0, a=1.0),
    )  # fmt: skip
