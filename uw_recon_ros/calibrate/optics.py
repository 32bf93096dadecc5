"""The numbers of a rig as one vector, and where they put a board's points, with slopes.

The vector: for the left and then the right camera ``fx fy cx cy k1 k2 p1 p2 k3``, then the rotation vector and the
translation of ``x_right = R x_left + t``.
"""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np

from uw_recon_ros.types import Matrix

OF_CAMERA = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
NAMES = (
    *(f"left_{name}" for name in OF_CAMERA), *(f"right_{name}" for name in OF_CAMERA),
    "rotation_x", "rotation_y", "rotation_z", "translation_x", "translation_y", "translation_z",
)  # fmt: skip
_SHAPE = len(OF_CAMERA)
EXTRINSIC = slice(2 * _SHAPE, 2 * _SHAPE + 6)
SIDES = (slice(0, _SHAPE), slice(_SHAPE, 2 * _SHAPE))


def intrinsic_matrix(camera: Matrix) -> Matrix:
    """(3, 3) K of one camera's numbers."""
    fx, fy, cx, cy = camera[:4]
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def project_left(numbers: Matrix, pose: Matrix, points: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """Pixels of board points in the left camera, and their slopes.

    Parameters
    ----------
    numbers : (24,) float64
    pose : (6,) float64
        Rotation vector and translation, left camera from board.
    points : (N, 3) float64
        m.

    Returns
    -------
    (N, 2), (2N, 24), (2N, 6) float64
        px; slopes by the numbers and by the pose.
    """
    pixels, slopes = _projected(numbers[SIDES[0]], pose, points)
    by_numbers = np.zeros((len(slopes), len(numbers)))
    by_numbers[:, SIDES[0]] = slopes[:, 6:]
    return pixels, by_numbers, slopes[:, :6]


def project_right(numbers: Matrix, pose: Matrix, points: Matrix) -> tuple[Matrix, Matrix, Matrix]:
    """As `project_left`, in the right camera; the pose is still the left one's."""
    chain = cv2.composeRT(*_split(pose), *_split(numbers[EXTRINSIC]))
    turned, moved = (np.asarray(part, np.float64).ravel() for part in chain[:2])
    pixels, slopes = _projected(numbers[SIDES[1]], np.concatenate([turned, moved]), points)
    by_pose, by_rig = _chain_slopes(chain)
    by_numbers = np.zeros((len(slopes), len(numbers)))
    by_numbers[:, SIDES[1]] = slopes[:, 6:]
    by_numbers[:, EXTRINSIC] = slopes[:, :6] @ by_rig
    return pixels, by_numbers, slopes[:, :6] @ by_pose


def _split(motion: Matrix) -> tuple[Matrix, Matrix]:
    return motion[:3].reshape(3, 1), motion[3:].reshape(3, 1)


def _chain_slopes(chain: Any) -> tuple[Matrix, Matrix]:
    """(6, 6) slopes of a composed motion by its first and by its second part."""
    r_r1, r_t1, r_r2, r_t2, t_r1, t_t1, t_r2, t_t2 = (np.asarray(part, np.float64) for part in chain[2:])
    return np.block([[r_r1, r_t1], [t_r1, t_t1]]), np.block([[r_r2, r_t2], [t_r2, t_t2]])


def _projected(camera: Matrix, pose: Matrix, points: Matrix) -> tuple[Matrix, Matrix]:
    """Pixels, and slopes by rotation, translation, fx fy cx cy and distortion."""
    if not len(points):
        return np.empty((0, 2)), np.empty((0, 6 + _SHAPE))
    pixels, slopes = cv2.projectPoints(points, pose[:3], pose[3:], intrinsic_matrix(camera), camera[4:].copy())
    return np.asarray(pixels, np.float64).reshape(-1, 2), np.asarray(slopes, np.float64)[:, : 6 + _SHAPE]
