"""The rectified frame in tf: how it is turned against the left camera's own.

Clouds are expressed in the left camera's own frame; rectified images, disparity and depth show what a camera turned by
the rectifying rotation sees. Where ``tf2_msgs`` is installed, a static transform says how the two frames lie to each
other, under the names of `types.optical_frame` and `types.rectified_frame`.
"""

from __future__ import annotations

import math

import numpy as np
from geometry_msgs.msg import Quaternion, Transform, TransformStamped, Vector3

from uw_recon_ros.rigid import quaternion
from uw_recon_ros.ros.declared_topics import Output
from uw_recon_ros.ros.message_types import message_class
from uw_recon_ros.ros.messages import header
from uw_recon_ros.ros.outputs import Outputs
from uw_recon_ros.types import StereoGeometry, optical_frame, rectified_frame

TOPIC = "/tf_static"
#: Why there is no transform, where there is none.
ABSENT = f"tf2_msgs is not installed: no {TOPIC} for the rectified frame"
_MESSAGE = message_class("tf2_msgs/msg/TFMessage")
OUTPUTS = (Output(TOPIC, _MESSAGE, latched=True, quiet=True),) if _MESSAGE is not None else ()


def rectifying_transform(geometry: StereoGeometry, stamp_ns: int, frame_id: str) -> TransformStamped:
    """Say how the rectified frame lies in the left camera's own: turned about one centre.

    Parameters
    ----------
    geometry : StereoGeometry
    stamp_ns : int
    frame_id : str
        Either frame's name.

    Returns
    -------
    TransformStamped
        Parent: the optical frame; child: the rectified one. Takes coordinates in the child to those in the parent.
    """
    raw_from_rect = np.asarray(geometry.rect_from_raw_left, np.float64).T
    x, y, z, w = quaternion(raw_from_rect).tolist()
    return TransformStamped(
        header=header(stamp_ns, optical_frame(frame_id)),
        child_frame_id=rectified_frame(frame_id),
        transform=Transform(translation=Vector3(), rotation=Quaternion(x=x, y=y, z=z, w=w)),
    )


def rotation_deg(geometry: StereoGeometry) -> float:
    """By how much rectification turns the left camera, degrees."""
    w = float(quaternion(np.asarray(geometry.rect_from_raw_left, np.float64))[3])
    return math.degrees(2 * math.acos(min(w, 1.0)))


def tell_rectified_frame(outputs: Outputs, geometry: StereoGeometry, stamp_ns: int, frame_id: str) -> None:
    """Publish the transform, if tf is there and it is news."""
    value = (optical_frame(frame_id), geometry.rect_from_raw_left)
    if _MESSAGE is not None:
        outputs.tell(TOPIC, value, lambda: _MESSAGE(transforms=[rectifying_transform(geometry, stamp_ns, frame_id)]))
