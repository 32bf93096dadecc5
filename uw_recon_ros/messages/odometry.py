"""Where the vehicle is -> messages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from uw_recon_ros.messages.factory import MessageFactory
from uw_recon_ros.messages.headers import header
from uw_recon_ros.rigid import quaternion
from uw_recon_ros.trajectory import VehicleState
from uw_recon_ros.types import Matrix

ODOMETRY, PATH = "nav_msgs/msg/Odometry", "nav_msgs/msg/Path"


def _rotation(make: MessageFactory, pose: Matrix) -> Any:
    x, y, z, w = quaternion(pose[:3, :3]).tolist()
    return make("geometry_msgs/msg/Quaternion", x=x, y=y, z=z, w=w)


def _vector(make: MessageFactory, kind: str, values: Matrix) -> Any:
    x, y, z = values.tolist()
    return make(f"geometry_msgs/msg/{kind}", x=x, y=y, z=z)


def pose_message(make: MessageFactory, pose: Matrix) -> Any:
    """Make a ``Pose`` of a (4, 4) rigid motion."""
    return make(
        "geometry_msgs/msg/Pose", position=_vector(make, "Point", pose[:3, 3]), orientation=_rotation(make, pose)
    )


def odometry_message(make: MessageFactory, state: VehicleState) -> Any:
    """Make an ``Odometry``."""
    twist = make(
        "geometry_msgs/msg/Twist", linear=_vector(make, "Vector3", state.velocity[:3]),
        angular=_vector(make, "Vector3", state.velocity[3:]),
    )  # fmt: skip
    return make(
        ODOMETRY, header=header(make, state.stamp_ns, state.frame_id), child_frame_id=state.child_frame_id,
        pose=make("geometry_msgs/msg/PoseWithCovariance", pose=pose_message(make, state.pose),
                  covariance=state.covariance.ravel()),
        twist=make("geometry_msgs/msg/TwistWithCovariance", twist=twist, covariance=state.velocity_covariance.ravel()),
    )  # fmt: skip


def path_message(make: MessageFactory, stamps_ns: Sequence[int], poses: Sequence[Matrix], frame_id: str) -> Any:
    """Make a ``Path``, stamped as its last pose."""
    listed = [
        make("geometry_msgs/msg/PoseStamped", header=header(make, stamp, frame_id), pose=pose_message(make, pose))
        for stamp, pose in zip(stamps_ns, poses, strict=True)
    ]
    return make(PATH, header=header(make, stamps_ns[-1], frame_id), poses=listed)


def transform_message(make: MessageFactory, stamp_ns: int, frame_id: str, child_frame_id: str, pose: Matrix) -> Any:
    """Make a ``TransformStamped``: `pose` takes coordinates in the child to those in `frame_id`."""
    transform = make(
        "geometry_msgs/msg/Transform", translation=_vector(make, "Vector3", pose[:3, 3]),
        rotation=_rotation(make, pose),
    )  # fmt: skip
    return make(
        "geometry_msgs/msg/TransformStamped", header=header(make, stamp_ns, frame_id), child_frame_id=child_frame_id,
        transform=transform,
    )  # fmt: skip
