"""Depth, clouds and surfaces -> messages."""

from __future__ import annotations

import sys

import numpy as np
from builtin_interfaces.msg import Duration
from geometry_msgs.msg import Point, Vector3
from numpy.typing import NDArray
from sensor_msgs.msg import CameraInfo, Image, PointCloud2, PointField
from std_msgs.msg import ColorRGBA
from visualization_msgs.msg import Marker

from uw_recon_ros.ros.geometry import rectified_info
from uw_recon_ros.ros.messages import fill, float_message, header
from uw_recon_ros.types import ByteImage, DepthMap, PointCloud, Surface

_FIELDS = [
    PointField(name=name, offset=4 * i, datatype=PointField.FLOAT32, count=1)
    for i, name in enumerate(("x", "y", "z", "rgb"))
]
_POINT_STEP = 16


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


def cloud_message(cloud: PointCloud) -> PointCloud2:
    """Make a ``PointCloud2`` of x, y, z, rgb float32.

    An (H, W, 3) cloud becomes an organised one that may hold NaN (``is_dense`` false), an (N, 3) cloud one row.
    """
    points = cloud.points if cloud.points.ndim == 3 else cloud.points[np.newaxis]
    colors = cloud.colors.reshape(points.shape)
    height, width = points.shape[:2]
    table = np.empty((height, width, 4), np.float32)
    table[..., :3] = points
    table[..., 3] = pack_rgb(np.ascontiguousarray(colors))
    message = PointCloud2(header=header(cloud.stamp_ns, cloud.frame_id), height=height, width=width, fields=_FIELDS)
    message.is_bigendian = sys.byteorder == "big"
    message.point_step, message.row_step = _POINT_STEP, _POINT_STEP * width
    message.is_dense = cloud.points.ndim == 2
    fill(message, table)
    return message


def depth_messages(depth: DepthMap) -> tuple[Image, Image, CameraInfo]:
    """Make ``depth/image_rect``, ``depth/sigma`` and ``depth/camera_info`` (REP 118)."""
    head = header(depth.stamp_ns, depth.frame_id)
    height, width = depth.depth.shape
    info = rectified_info(depth.geometry.intrinsics_left, (width, height), head)
    return float_message(depth.depth, head), float_message(depth.sigma, head), info


def surface_message(surface: Surface) -> Marker:
    """Make a ``TRIANGLE_LIST`` marker with a colour at every corner.

    Its name space is ``surface``, or ``surface_unscaled`` where the unit is not the metre. An empty surface deletes
    the one before.
    """
    marker = Marker(header=header(surface.stamp_ns, surface.frame_id), type=Marker.TRIANGLE_LIST)
    marker.ns = "surface" if surface.metric else "surface_unscaled"
    marker.action = Marker.ADD if len(surface.faces) else Marker.DELETE
    marker.pose.orientation.w = 1.0
    marker.scale = Vector3(x=1.0, y=1.0, z=1.0)
    marker.color = ColorRGBA(r=1.0, g=1.0, b=1.0, a=1.0)
    marker.lifetime = Duration()
    corners = surface.faces.ravel().tolist()
    points = [Point(x=x, y=y, z=z) for x, y, z in surface.vertices.astype(np.float64).tolist()]
    colors = [ColorRGBA(r=r, g=g, b=b, a=1.0) for r, g, b in (surface.colors / 255.0).tolist()]
    marker.points = [points[i] for i in corners]  # corners share their vertex's object: 6 times fewer to make
    marker.colors = [colors[i] for i in corners]
    return marker
