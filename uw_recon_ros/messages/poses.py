"""Poses and transforms -> messages."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from uw_recon_ros.messages.factory import MessageFactory

POSE = "geometry_msgs/msg/PoseStamped"


def pose_message(make: MessageFactory, position: NDArray[Any], quaternion: NDArray[Any], head: Any) -> Any:
    """PoseStamped of a position (3,) in m and a unit quaternion (4,) x, y, z, w."""
    x, y, z = (float(value) for value in position)
    qx, qy, qz, qw = (float(value) for value in quaternion)
    pose = make(
        "geometry_msgs/msg/Pose",
        position=make("geometry_msgs/msg/Point", x=x, y=y, z=z),
        orientation=make("geometry_msgs/msg/Quaternion", x=qx, y=qy, z=qz, w=qw),
    )
    return make(POSE, header=head, pose=pose)
