"""Where the vehicle is -> messages."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from uw_recon_ros import rigid
from uw_recon_ros.errors import MessageError
from uw_recon_ros.messages.factory import MessageFactory
from uw_recon_ros.messages.headers import header
from uw_recon_ros.rigid import quaternion
from uw_recon_ros.trajectory import VehicleState, pose_matrix
from uw_recon_ros.types import Matrix

ODOMETRY, PATH = "nav_msgs/msg/Odometry", "nav_msgs/msg/Path"
_NOT_UNIT, _FARTHEST_M = 0.01, 1e6  # beyond which it is no pose of a vehicle's odometry


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


def view_from_odometry(message: Any, view_from_child: Matrix) -> tuple[Matrix, Matrix]:
    """Where a received ``Odometry`` puts the left view.

    Parameters
    ----------
    message : Odometry
    view_from_child : (4, 4) float64
        Left rectified view <- the message's ``child_frame_id``.

    Returns
    -------
    pose : (4, 4) float64
        ``header.frame_id`` <- left rectified view, m.
    covariance : (6, 6) float64
        Of the twist on the right.

    Raises
    ------
    MessageError
        It holds no pose.
    """
    p, q = message.pose.pose.position, message.pose.pose.orientation
    place, turn = np.array([p.x, p.y, p.z]), np.array([q.x, q.y, q.z, q.w])
    covariance = np.array(message.pose.covariance, np.float64).reshape(6, 6)
    known = np.isfinite(np.r_[place, turn]).all() and np.isfinite(covariance).all()
    if not known or abs(np.linalg.norm(turn) - 1) > _NOT_UNIT or np.abs(place).max() > _FARTHEST_M:
        raise MessageError(
            f"odometry: expected a finite pose with a unit quaternion, got position {place.round(3).tolist()}, "
            f"orientation {turn.round(3).tolist()}"
        )
    child = pose_matrix(place, Rotation.from_quat(turn).as_matrix())
    change = rigid.adjoint(view_from_child) @ np.kron(np.eye(2), child[:3, :3].T)
    return child @ rigid.inverse(view_from_child), change @ covariance @ change.T


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
