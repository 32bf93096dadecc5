"""The numbers of a rig as one vector, and where they put a board's points, with slopes.

The vector: for the left and then the right camera nine numbers, ``fx fy cx cy`` and the shape of its lens, then the
rotation vector and the translation of ``x_right = R x_left + t``. The shape of a plumb_bob lens is ``k1 k2 p1 p2 k3``,
of an equidistant one (a fisheye; Kannala, Brandt 2006) ``k1 k2 k3 k4`` and a number that is not used.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import cv2
import numpy as np

from uw_recon_ros.lenses import EQUIDISTANT, PLUMB_BOB
from uw_recon_ros.types import Matrix

_UNUSED = ""
_OF_CAMERA = {
    PLUMB_BOB: ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"),
    EQUIDISTANT: ("fx", "fy", "cx", "cy", "k1", "k2", "k3", "k4", _UNUSED),
}
_OF_POSE = ("rotation_x", "rotation_y", "rotation_z", "translation_x", "translation_y", "translation_z")


def names_of(lens: str) -> tuple[str, ...]:
    """Of the 24 numbers; empty where one is not used."""
    cameras = [f"{side}_{name}" if name else _UNUSED for side in ("left", "right") for name in _OF_CAMERA[lens]]
    return (*cameras, *_OF_POSE)


NAMES = names_of(PLUMB_BOB)
OF_CAMERA = len(_OF_CAMERA[PLUMB_BOB])
EXTRINSIC = slice(2 * OF_CAMERA, 2 * OF_CAMERA + 6)
SIDES = (slice(0, OF_CAMERA), slice(OF_CAMERA, 2 * OF_CAMERA))


def intrinsic_matrix(camera: Matrix) -> Matrix:
    """(3, 3) K of one camera's numbers."""
    fx, fy, cx, cy = camera[:4]
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])


def shape_of(camera: Matrix, lens: str) -> Matrix:
    """Distortion of one camera's numbers, as OpenCV and ROS count it."""
    return np.array(camera[4 : OF_CAMERA - (lens == EQUIDISTANT)])


def project_left(numbers: Matrix, pose: Matrix, points: Matrix, lens: str = PLUMB_BOB) -> tuple[Matrix, Matrix, Matrix]:
    """Pixels of board points in the left camera, and their slopes.

    Parameters
    ----------
    numbers : (24,) float64
    pose : (6,) float64
        Rotation vector and translation, left camera from board.
    points : (N, 3) float64
        m.
    lens : {'plumb_bob', 'equidistant'}

    Returns
    -------
    (N, 2), (2N, 24), (2N, 6) float64
        px; slopes by the numbers and by the pose.
    """
    pixels, slopes = project_camera(numbers[SIDES[0]], pose, points, lens)
    by_numbers = np.zeros((len(slopes), len(numbers)))
    by_numbers[:, SIDES[0]] = slopes[:, 6:]
    return pixels, by_numbers, slopes[:, :6]


def project_right(
    numbers: Matrix, pose: Matrix, points: Matrix, lens: str = PLUMB_BOB
) -> tuple[Matrix, Matrix, Matrix]:
    """As `project_left`, in the right camera; the pose is still the left one's."""
    chain = cv2.composeRT(*_split(pose), *_split(numbers[EXTRINSIC]))
    turned, moved = (np.asarray(part, np.float64).ravel() for part in chain[:2])
    pixels, slopes = project_camera(numbers[SIDES[1]], np.concatenate([turned, moved]), points, lens)
    by_pose, by_rig = _chain_slopes(chain)
    by_numbers = np.zeros((len(slopes), len(numbers)))
    by_numbers[:, SIDES[1]] = slopes[:, 6:]
    by_numbers[:, EXTRINSIC] = slopes[:, :6] @ by_rig
    return pixels, by_numbers, slopes[:, :6] @ by_pose


#: The left camera and the right one.
PROJECTIONS = {
    lens: (partial(project_left, lens=lens), partial(project_right, lens=lens)) for lens in (PLUMB_BOB, EQUIDISTANT)
}


def _split(motion: Matrix) -> tuple[Matrix, Matrix]:
    return motion[:3].reshape(3, 1), motion[3:].reshape(3, 1)


def _chain_slopes(chain: Any) -> tuple[Matrix, Matrix]:
    """(6, 6) slopes of a composed motion by its first and by its second part."""
    r_r1, r_t1, r_r2, r_t2, t_r1, t_t1, t_r2, t_t2 = (np.asarray(part, np.float64) for part in chain[2:])
    return np.block([[r_r1, r_t1], [t_r1, t_t1]]), np.block([[r_r2, r_t2], [t_r2, t_t2]])


def project_camera(camera: Matrix, pose: Matrix, points: Matrix, lens: str = PLUMB_BOB) -> tuple[Matrix, Matrix]:
    """Pixels (N, 2) of one camera, and slopes (2N, 15) by rotation, translation and its nine numbers."""
    if not len(points):
        return np.empty((0, 2)), np.empty((0, 6 + OF_CAMERA))
    k, shape = intrinsic_matrix(camera), shape_of(camera, lens)
    if lens == EQUIDISTANT:
        turn, move = (part.copy() for part in _split(pose))
        pixels, slopes = cv2.fisheye.projectPoints(points.reshape(-1, 1, 3), turn, move, k, shape)
        slopes = np.asarray(slopes, np.float64)
        ordered = np.c_[slopes[:, 8:14], slopes[:, :8], np.zeros(len(slopes))]  # the numbers come first there
    else:
        pixels, slopes = cv2.projectPoints(points, pose[:3], pose[3:], k, shape)
        ordered = np.asarray(slopes, np.float64)[:, : 6 + OF_CAMERA]
    return np.asarray(pixels, np.float64).reshape(-1, 2), ordered
