"""The six unknowns of quasi-Euclidean rectification and the fundamental matrix they make (paper eq. 15)."""

from __future__ import annotations

import numpy as np

from uw_recon_ros.types import Matrix

_U1_CROSS = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])  # eq. 11
LOG3 = np.log(3.0)


def rotation_about(axis: int, angle: float, derivative: bool = False) -> Matrix:
    """Rotation about one axis, or its derivative by the angle."""
    if derivative:
        matrix = rotation_about(axis, angle + np.pi / 2)
        matrix[axis, axis] = 0.0
        return matrix
    i, j = (axis + 1) % 3, (axis + 2) % 3
    matrix = np.eye(3)
    matrix[i, i] = matrix[j, j] = np.cos(angle)
    matrix[j, i] = np.sin(angle)
    matrix[i, j] = -matrix[j, i]
    return matrix


def _chain(x: float, y: float, z: float) -> tuple[Matrix, list[Matrix]]:
    """``R_x R_z R_y`` and its derivatives by x, y, z: rotations about x on the left drop out of eq. 15."""
    about = [rotation_about(axis, angle) for axis, angle in enumerate((x, y, z))]
    slope = [rotation_about(axis, angle, derivative=True) for axis, angle in enumerate((x, y, z))]
    return about[0] @ about[2] @ about[1], [
        slope[0] @ about[2] @ about[1],
        about[0] @ about[2] @ slope[1],
        about[0] @ slope[2] @ about[1],
    ]


def rotations(unknowns: Matrix) -> tuple[Matrix, Matrix]:
    """Left and right rotation of the unknowns (y_l, z_l, x_r, y_r, z_r, alpha')."""
    y_l, z_l, x_r, y_r, z_r = unknowns[:5]
    return _chain(0.0, y_l, z_l)[0], _chain(x_r, y_r, z_r)[0]


def fundamental_and_jacobian(unknowns: Matrix) -> tuple[Matrix, Matrix]:
    """Eq. 15 for pixels centred and divided by ``w + h``, and its derivative.

    Returns
    -------
    fundamental : (3, 3) float64
    jacobian : (9, 6) float64
        Rows in the order of ``fundamental.ravel()``.
    """
    y_l, z_l, x_r, y_r, z_r, alpha = unknowns
    focal = 3.0 ** np.clip(alpha, -20.0, 20.0)  # a wild step must not overflow
    k, dk = np.diag([1.0, 1.0, focal]), np.diag([0.0, 0.0, LOG3 * focal])  # K^-1 times the focal length
    left, left_slopes = _chain(0.0, y_l, z_l)
    right, right_slopes = _chain(x_r, y_r, z_r)
    essential = right.T @ _U1_CROSS @ left
    by_left = [k @ right.T @ _U1_CROSS @ slope @ k for slope in left_slopes[1:]]
    by_right = [k @ slope.T @ _U1_CROSS @ left @ k for slope in right_slopes]
    by_focal = dk @ essential @ k + k @ essential @ dk
    jacobian = np.stack([d.ravel() for d in (*by_left, *by_right, by_focal)], axis=1)
    return k @ essential @ k, jacobian
