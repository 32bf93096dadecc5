"""A rig out of two single cameras and how they stand to each other: what most calibration files hold."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from scipy.spatial.transform import Rotation

from uw_recon_ros.calibration.model import make_camera
from uw_recon_ros.errors import CalibrationError
from uw_recon_ros.findings import Code
from uw_recon_ros.types import Axis, Matrix, StereoCalibration


@dataclass(frozen=True, eq=False)
class Lens:
    """One camera for itself.

    Parameters
    ----------
    size : (width, height)
        Of the images it was calibrated with, px.
    k : (3, 3)
        Pixel (0, 0) is the centre of the first one.
    d : (N,)
        Distortion in OpenCV's order.
    model : str
        ROS's name of the distortion, or an alias of it.
    frame_id : str
    """

    size: tuple[int, int]
    k: Matrix
    d: Matrix
    model: str = "plumb_bob"
    frame_id: str = ""


@dataclass(frozen=True, eq=False)
class Rectified:
    """R and P of both cameras, where a file brings them."""

    r: tuple[Matrix, Matrix]
    p: tuple[Matrix, Matrix]


@dataclass(frozen=True, eq=False)
class Parts:
    """What a file says of a rig.

    Parameters
    ----------
    left, right : Lens
    rotation : (3, 3)
        x_right = rotation x_left + translation.
    translation : (3,)
        m.
    rectified : Rectified or None
    """

    left: Lens
    right: Lens
    rotation: Matrix
    translation: Matrix
    rectified: Rectified | None = field(default=None)

    def rig(self) -> StereoCalibration:
        """The calibration; rectifying rotations are found where the file has none.

        Raises
        ------
        CalibrationError
            The numbers make no camera, or no rig.
        """
        found = self.rectified or rectify(self)
        left, right = (
            make_camera(
                width=lens.size[0], height=lens.size[1], k=lens.k, d=lens.d, r=r, p=p,
                distortion_model=lens.model, frame_id=lens.frame_id,
            )
            for lens, r, p in zip((self.left, self.right), found.r, found.p, strict=True)
        )  # fmt: skip
        return StereoCalibration(left, right)


def rectify(parts: Parts) -> Rectified:
    """R and P of both cameras: each takes half of the turn between them, then both turn the baseline onto an axis."""
    rotation = _nearest_rotation(parts.rotation)
    center = -rotation.T @ np.asarray(parts.translation, np.float64).ravel()
    if center.shape != (3,) or not np.isfinite(center).all() or not center.any():
        raise CalibrationError(
            f"translation: expected three numbers, not all 0, got {center.tolist()}", Code.CALIBRATION_NO_BASELINE
        )
    axis: Axis = "horizontal" if abs(center[0]) >= abs(center[1]) else "vertical"
    turns, common, baseline = rectifying_views(
        (parts.left.k, parts.right.k), Rotation.from_matrix(rotation).as_rotvec(), center, axis, parts.left.size
    )
    shift = np.zeros((3, 1))
    shift[0 if axis == "horizontal" else 1, 0] = -common[0, 0] * baseline
    return Rectified(turns, (np.hstack([common, np.zeros((3, 1))]), np.hstack([common, shift])))


def _nearest_rotation(given: Matrix) -> Matrix:
    """Files round their numbers; what is no rotation at all is refused."""
    matrix = np.asarray(given, np.float64)
    if matrix.shape == (3, 3) and np.isfinite(matrix).all():
        u, _, v = np.linalg.svd(matrix)
        nearest: Matrix = u @ v
        if np.linalg.det(nearest) > 0 and np.abs(nearest - matrix).max() < 1e-2:
            return nearest
    raise CalibrationError(f"R: expected a rotation, got {matrix.tolist()}", Code.CALIBRATION_NOT_A_ROTATION)


def rectifying_views(
    intrinsics: tuple[Matrix, Matrix], turn: Matrix, center: Matrix, axis: Axis, size: tuple[int, int]
) -> tuple[tuple[Matrix, Matrix], Matrix, float]:
    """Rectifying rotations of both cameras, the common intrinsic matrix, and the baseline in m.

    Parameters
    ----------
    intrinsics : two (3, 3)
    turn : (3,)
        Axis-angle of right_from_left, rad.
    center : (3,)
        Of the right camera in the left optical frame, m.
    axis : {'horizontal', 'vertical'}
    size : (width, height)

    Returns
    -------
    turns : two (3, 3)
    common : (3, 3)
    baseline_m : float
        Negative where the second camera stands on the other side (left, or above).
    """
    half = Rotation.from_rotvec(turn / 2).as_matrix()
    baseline = half @ center
    side = 1.0 if baseline[0 if axis == "horizontal" else 1] >= 0 else -1.0
    first = side * baseline / np.linalg.norm(baseline)
    ahead = np.array([0.0, 0.0, 1.0])
    second = np.cross(ahead, first) if axis == "horizontal" else np.cross(first, ahead)
    second /= np.linalg.norm(second)
    rows = (first, second, np.cross(first, second))
    align = np.stack(rows if axis == "horizontal" else (second, first, np.cross(second, first)))
    turns = align @ half, align @ half.T
    focal = float(np.mean([np.diag(k)[:2].mean() for k in intrinsics]))
    middle = np.array([(size[0] - 1) / 2, (size[1] - 1) / 2, 1.0])
    seen = [r @ np.linalg.solve(k, middle) for r, k in zip(turns, intrinsics, strict=True)]
    cx, cy = middle[:2] - focal * np.mean([ray[:2] / ray[2] for ray in seen], axis=0)
    common = np.array([[focal, 0.0, cx], [0.0, focal, cy], [0.0, 0.0, 1.0]])
    return turns, common, side * float(np.linalg.norm(baseline))


def right_from_left(calibration: StereoCalibration) -> tuple[Matrix, Matrix]:
    """Rotation (3, 3) and translation (3,), m: x_right = rotation x_left + translation."""
    left, right = calibration.left, calibration.right
    shift = (right.p[:, 3] - left.p[:, 3]) / np.array([right.p[0, 0], right.p[1, 1], 1.0])
    rotation: Matrix = right.r.T @ left.r
    translation: Matrix = right.r.T @ shift
    return rotation, translation
