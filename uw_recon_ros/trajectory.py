"""The trajectory of a dive: a pose a frame, its covariance, and how it came about."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from uw_recon_ros.types import ByteImage, FloatImage, Matrix, StereoGeometry


class PoseStatus(IntEnum):
    """How a pose came about."""

    TRACKED = 0  #: by features in the pictures
    BRIDGED = 1  #: by the shape of the bottom alone, where features were lost
    PREDICTED = 2  #: nothing was seen: where the vehicle would be if it went on
    GIVEN = 3  #: from outside, e.g. the bag's odometry

    def __str__(self) -> str:
        """The name as it stands in files."""
        return self.name.lower()


@dataclass(frozen=True, eq=False)
class DisparityFrame:
    """One frame of a dive, as far as track, fusion and maps need it.

    Parameters
    ----------
    stamp_ns : int
    left : (H, W, 3) or (H, W) uint8
        Enhanced left rectified view; RGB where its colours are wanted.
    disparity, sigma : (H, W) float32
        px; NaN = invalid.
    geometry : StereoGeometry
    """

    stamp_ns: int
    left: ByteImage
    disparity: FloatImage
    sigma: FloatImage
    geometry: StereoGeometry


@dataclass(frozen=True, eq=False)
class Trajectory:
    """Where the camera was at each frame.

    Parameters
    ----------
    stamps_ns : (N,) int64
        Header stamps of the left images, ns, increasing.
    poses : (N, 4, 4) float64
        ``world <- left rectified optical frame``, m (baselines where not metric), less `origin`.
    covariances : (N, 6, 6) float64
        Of x, y, z (m), then rotation about x, y, z (rad), all in the camera's own frame: the true pose is
        ``pose exp(xi)``. Relative to the first pose of the segment; NaN = unknown.
    status : (N,) uint8
        `PoseStatus`.
    segment : (N,) int64
        Frames of one number are joined to each other; others lie anywhere relative to them.
    origin : (3,) float64
        Subtracted from the world's coordinates, m: add it to have them back.
    metric : bool
        Whether lengths are metres.
    """

    stamps_ns: NDArray[np.int64]
    poses: Matrix
    covariances: Matrix
    status: NDArray[np.uint8]
    segment: NDArray[np.int64]
    origin: Matrix
    metric: bool = True

    def __post_init__(self) -> None:
        n = len(self.stamps_ns)
        shapes = {"stamps_ns": (n,), "poses": (n, 4, 4), "covariances": (n, 6, 6), "status": (n,), "segment": (n,),
                  "origin": (3,)}  # fmt: skip
        for name, expected in shapes.items():
            if getattr(self, name).shape != expected:
                raise ValueError(f"{name}: expected the shape {expected}, got {getattr(self, name).shape}")
        if n > 1 and not (np.diff(self.stamps_ns) > 0).all():
            at = int(np.argmin(np.diff(self.stamps_ns)))
            raise ValueError(f"stamps_ns: expected increasing ones, got {self.stamps_ns[at : at + 2].tolist()}")

    def __len__(self) -> int:
        return len(self.stamps_ns)

    @property
    def positions(self) -> Matrix:
        """(N, 3) float64, m, less `origin`."""
        return self.poses[:, :3, 3]

    @property
    def rotations(self) -> Matrix:
        """(N, 3, 3) float64, world <- camera."""
        return self.poses[:, :3, :3]

    def picked(self, which: NDArray[np.bool_] | NDArray[np.intp]) -> Trajectory:
        """Some frames of it, as a mask (N,) or increasing indices say."""
        return replace(
            self, stamps_ns=self.stamps_ns[which], poses=self.poses[which], covariances=self.covariances[which],
            status=self.status[which], segment=self.segment[which],
        )  # fmt: skip

    def turned(self, rotation: Matrix | Sequence[Sequence[float]]) -> Trajectory:
        """The trajectory in another frame with the same origin: `rotation` (3, 3) is camera <- that frame.

        ``trajectory.turned(geometry.rect_from_raw_left)`` is that of the camera's own, unrectified optical frame.
        """
        turn = np.asarray(rotation, np.float64)
        poses = self.poses.copy()
        poses[:, :3, :3] = self.rotations @ turn
        change = np.kron(np.eye(2), turn.T)
        return replace(self, poses=poses, covariances=change @ self.covariances @ change.T)


@dataclass(frozen=True, eq=False)
class JointCovariance:
    """How the errors of some poses hang together.

    Parameters
    ----------
    index : (C,) int64
        Numbers of poses, increasing.
    matrix : (6C, 6C) float64
        Of their twists on the right, pose by pose.
    """

    index: NDArray[np.int64]
    matrix: Matrix


@dataclass(frozen=True, eq=False)
class VehicleState:
    """Where the vehicle is and how it moves, as ROS tells it (REP 103, REP 105).

    Parameters
    ----------
    stamp_ns : int
    frame_id, child_frame_id : str
        The world's frame, and the vehicle's.
    pose : (4, 4) float64
        `frame_id` <- `child_frame_id`, m.
    covariance : (6, 6) float64
        Of the position (m) and the rotation (rad), about the axes of `frame_id`.
    velocity : (6,) float64
        m/s and rad/s, in the axes of `child_frame_id`.
    velocity_covariance : (6, 6) float64
    """

    stamp_ns: int
    frame_id: str
    child_frame_id: str
    pose: Matrix
    covariance: Matrix
    velocity: Matrix
    velocity_covariance: Matrix


def trajectory_of(
    stamps_ns: Sequence[int] | NDArray[np.int64],
    poses: Matrix,
    *,
    status: PoseStatus = PoseStatus.GIVEN,
    origin: Matrix | None = None,
    metric: bool = True,
) -> Trajectory:
    """A trajectory in one segment whose covariance is not known, e.g. one that was given."""
    n = len(stamps_ns)
    return Trajectory(
        np.asarray(stamps_ns, np.int64), np.asarray(poses, np.float64).reshape(n, 4, 4), np.full((n, 6, 6), np.nan),
        np.full(n, int(status), np.uint8), np.zeros(n, np.int64),
        np.zeros(3) if origin is None else np.asarray(origin, np.float64), metric,
    )  # fmt: skip


def pose_matrix(position: Matrix, rotation: Matrix) -> Matrix:
    """(4, 4) rigid transform of a position (3,) and a rotation matrix (3, 3)."""
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = rotation, position
    return pose


def as_quaternions(poses: Matrix) -> Matrix:
    """(N, 4) unit quaternions x, y, z, w >= 0 of poses (N, 4, 4)."""
    if not len(poses):
        return np.zeros((0, 4))
    found: Matrix = Rotation.from_matrix(poses[:, :3, :3]).as_quat()
    return np.where(found[:, 3:] < 0, -found, found)
