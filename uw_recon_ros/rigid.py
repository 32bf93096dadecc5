"""Rigid motions SE(3), many at a time: exponential, logarithm, adjoint. A twist is translation, then rotation."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from uw_recon_ros.types import Matrix

_TINY = 1e-6


def skew(v: Matrix) -> Matrix:
    """(..., 3, 3) matrices of the cross product with `v` (..., 3)."""
    zero = np.zeros(v.shape[:-1])
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    return np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(*v.shape[:-1], 3, 3)


def _v_terms(angle: Matrix) -> tuple[Matrix, Matrix]:
    """``(1 - cos a) / a^2`` and ``(a - sin a) / a^3``."""
    safe = np.where(angle < _TINY, 1.0, angle)
    first = np.where(angle < _TINY, 0.5, (1 - np.cos(safe)) / safe**2)
    second = np.where(angle < _TINY, 1 / 6, (safe - np.sin(safe)) / safe**3)
    return first, second


def exp(twists: Matrix) -> Matrix:
    """(..., 4, 4) rigid motions of twists (..., 6): m, then rad."""
    flat = twists.reshape(-1, 6)
    phi = flat[:, 3:]
    a, b = (term[:, None, None] for term in _v_terms(np.linalg.norm(phi, axis=1)))
    cross = skew(phi)
    motions = np.tile(np.eye(4), (len(flat), 1, 1))
    motions[:, :3, :3] = Rotation.from_rotvec(phi).as_matrix() if len(flat) else np.zeros((0, 3, 3))
    left = np.eye(3) + a * cross + b * (cross @ cross)
    motions[:, :3, 3] = (left @ flat[:, :3, None])[..., 0]
    return motions.reshape(*twists.shape[:-1], 4, 4)


def log(motions: Matrix) -> Matrix:
    """(..., 6) twists of rigid motions (..., 4, 4); rotations below 180 degrees."""
    flat = motions.reshape(-1, 4, 4)
    phi = Rotation.from_matrix(flat[:, :3, :3]).as_rotvec() if len(flat) else np.zeros((0, 3))
    a, b = (term[:, None, None] for term in _v_terms(np.linalg.norm(phi, axis=1)))
    cross = skew(phi)
    left = np.eye(3) + a * cross + b * (cross @ cross)
    moved = np.linalg.solve(left, flat[:, :3, 3:])[..., 0]
    return np.concatenate([moved, phi], axis=1).reshape(*motions.shape[:-2], 6)


def inverse(motions: Matrix) -> Matrix:
    """(..., 4, 4) inverses."""
    turned = np.swapaxes(motions[..., :3, :3], -1, -2)
    found = np.zeros_like(motions)
    found[..., :3, :3] = turned
    found[..., :3, 3] = -(turned @ motions[..., :3, 3:])[..., 0]
    found[..., 3, 3] = 1.0
    return found


def adjoint(motions: Matrix) -> Matrix:
    """(..., 6, 6): ``T exp(x) T^-1 = exp(adjoint(T) x)``."""
    rotation, moved = motions[..., :3, :3], motions[..., :3, 3]
    found = np.zeros((*motions.shape[:-2], 6, 6))
    found[..., :3, :3] = found[..., 3:, 3:] = rotation
    found[..., :3, 3:] = skew(moved) @ rotation
    return found


def small_adjoint(twists: Matrix) -> Matrix:
    """(..., 6, 6): the Lie bracket with `twists` (..., 6)."""
    found = np.zeros((*twists.shape[:-1], 6, 6))
    found[..., :3, :3] = found[..., 3:, 3:] = skew(twists[..., 3:])
    found[..., :3, 3:] = skew(twists[..., :3])
    return found


def quaternion(rotation: Matrix) -> Matrix:
    """Unit quaternion (x, y, z, w), w >= 0, of a (3, 3) rotation; of the nearest one where it is not quite one.

    The quaternion is the eigenvector of the largest eigenvalue of a symmetric matrix made of the rotation (Bar-Itzhack,
    2000), which has no special cases.
    """
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = rotation
    symmetric = np.array([
        [xx - yy - zz, yx + xy, zx + xz, zy - yz],
        [yx + xy, yy - xx - zz, zy + yz, xz - zx],
        [zx + xz, zy + yz, zz - xx - yy, yx - xy],
        [zy - yz, xz - zx, yx - xy, xx + yy + zz],
    ])  # fmt: skip
    found: Matrix = np.linalg.eigh(symmetric)[1][:, -1]
    return found if found[3] >= 0 else -found
